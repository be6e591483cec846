"""Single numbers of lists in scene values: `engine.harmonic_amplitudes[1]` is the first number, of harmonic 2.

A list that has a profile (`model.quantity.PROFILES`) takes a profile of one of its numbers too: `KEY[n]_times` and
`KEY[n]_values`; the others stay as the scene has them.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from tcc_sim.errors import InputError
from tcc_sim.model.crank_speed import ORDER, frequency_key
from tcc_sim.model.quantity import PROFILES, number_of

_ELEMENT = re.compile(r"([\w.]+)\[(\d+)\](_times|_values)?")


def list_of(key: str) -> str:
    """Return the key of the list whose number, or times or values of a number, `key` names; else `key` itself."""
    match = _ELEMENT.fullmatch(key)
    return key if match is None else match[1] + (match[3] or "")


def index_of(key: str, whole: Any) -> int:
    """Return the index of the number that `key` names in its list; InputError if the list has no such number."""
    name, _, number = key.partition("[")
    place = int(number.partition("]")[0])
    if not isinstance(whole, Sequence) or isinstance(whole, str):
        if name.endswith("_values") and frequency_key(name) != name:
            raise InputError(f"{key}: a scene holds the speeds as frequencies; give {frequency_key(name)}[{place}], "
                             f"which is {ORDER} times the speed, or the whole {name}")
        raise InputError(f"{key}: {name} is not a list")
    if not 1 <= place <= len(whole):
        has = f"has {len(whole)} values, [1] to [{len(whole)}]" if whole else "is empty"
        raise InputError(f"{name}[{place}] does not exist: {name} {has}; give the whole list first")
    return place - 1


def with_whole_lists(values: Mapping[str, object], value_of: Callable[[str], Any]) -> Mapping[str, object]:
    """Return scene values with single numbers of lists replaced by the whole lists.

    Parameters
    ----------
    value_of : returns the present value of a key

    Raises
    ------
    InputError
        The list has no such number, a value is not a number, or the profiles of the numbers do not match.
    """
    if not any("[" in key for key in values):
        return values
    out = {key: value for key, value in values.items() if not _ELEMENT.fullmatch(key)}
    profiles: dict[str, dict[int, dict[str, Any]]] = defaultdict(lambda: defaultdict(dict))
    for key, value in values.items():
        match = _ELEMENT.fullmatch(key)
        if match is None:
            continue
        whole, part = match[1], match[3]
        now: Any = out.get(whole, value_of(whole))
        place = index_of(key, now)
        if part is not None:
            profiles[whole][place][part] = value
            continue
        try:
            out[whole] = [*now[:place], number_of(value), *now[place + 1:]]
        except TypeError:
            raise InputError(f"{key} is {value!r}; it must be a number") from None
    for whole, profile_lists in profiles.items():
        now = out.get(whole, value_of(whole))
        assert isinstance(now, Sequence)
        out.update(_profile(whole, profile_lists, now))
    return out


def _profile(whole: str, given: Mapping[int, Mapping[str, Any]], now: Sequence[float]) -> dict[str, object]:
    """Return times and values of a list in which some numbers, by index, have profiles and the others are constant."""
    for place, part in given.items():
        times, values = (part.get(name, []) for name in ("_times", "_values"))
        if whole not in PROFILES or not len(times) == len(values) > 0:
            raise InputError(f"{whole}[{place + 1}] has {len(times)} times and {len(values)} values of a profile; it "
                             f"must have as many of both, and the lists with profiles are "
                             f"{', '.join(key for key in PROFILES if key.endswith('s'))}")
    import numpy as np

    times = np.unique(np.concatenate([part["_times"] for part in given.values()]))
    rows = np.tile(np.array(now, dtype=np.float64), (len(times), 1))
    for place, part in given.items():
        rows[:, place] = np.interp(times, part["_times"], part["_values"])
    return {f"{whole}_times": times.tolist(), f"{whole}_values": rows.ravel().tolist()}
