"""Keys that may vary in time, linear between given points: what makes a profile, and how a command line gives one."""

from __future__ import annotations

import itertools

from tcc_sim.errors import InputError

PROFILES = ("engine.frequency", "engine.mean_torque", "pressure.mean")
"""The keys that may vary in time; each has a list of times and a list of values."""
MOST_POINTS = 1000
LATEST = 1e6
"""s"""


def check_profile(key: str, times: tuple[float, ...], values: tuple[float, ...]) -> None:
    """Raise InputError unless `times` and `values` make a profile of `key`, or are both empty."""
    if len(times) != len(values):
        raise InputError(f"{key}_values has {len(values)} values; it must have as many as {key}_times, {len(times)}")
    if len(times) > MOST_POINTS:
        raise InputError(f"{key}_times has {len(times)} values; at most {MOST_POINTS} are allowed")
    if times and times[0] != 0.0:
        raise InputError(f"{key}_times begins at {times[0]:g} s; the first time must be 0")
    for before, after in itertools.pairwise(times):
        if not after > before:
            raise InputError(f"{key}_times has {after:g} s after {before:g} s; the times must increase")


def parse_profiles(words: list[str]) -> dict[str, object]:
    """KEY=T:V,T:V words of a command line as values of the keys KEY_times and KEY_values.

    Raises
    ------
    InputError
        A key without a profile, one given twice, or a point that is not two numbers.
    """
    found: dict[str, object] = {}
    for word in words:
        key, _, points = word.partition("=")
        if key not in PROFILES:
            raise InputError(f"--profile {word[:100]}: the keys that have a profile are {', '.join(PROFILES)}")
        if f"{key}_times" in found:
            raise InputError(f"--profile {key} is given twice")
        try:
            pairs = [tuple(map(float, point.split(":"))) for point in points.split(",")]
        except ValueError:
            pairs = [()]
        if any(len(pair) != 2 for pair in pairs):
            raise InputError(f"--profile {word[:100]} is not KEY=TIME:VALUE,TIME:VALUE,... in s and the key's unit")
        found[f"{key}_times"], found[f"{key}_values"] = map(list, zip(*pairs))
    return found
