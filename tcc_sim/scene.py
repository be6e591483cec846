"""Scenes: System and node options, read from and written to ROS 2 parameter files. No other module reads these files.

A scene file is a ROS 2 parameter file (`/**: ros__parameters: ...`), so `--ros-args --params-file` takes it too.
"""

from __future__ import annotations

import dataclasses
import difflib
import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any, TypeAlias

from tcc_sim.errors import InputError
from tcc_sim.model import parameters
from tcc_sim.model.actuator import delay_ticks
from tcc_sim.model.groups import TABLE, TABULATED
from tcc_sim.model.parameters import DERIVED, FREQUENCY, SPEED, System, frequency_key, list_of, refuse_rpm
from tcc_sim.model.quantity import PROFILED, PROFILES, Options, Quantity, number_in, quantity
from tcc_sim.parameter_file import LARGEST_FILE, bundled_scenes, description_in, dumped, read_parameters
from tcc_sim.result import html_of

TABLE_FILE, TABLE_COLUMNS = "friction.table", "friction.table_columns"
"""Key that names such a file instead of the keys TABLE, and key that names its columns as --columns does."""
_COLUMNS = {"slip_speed": "rad/s", "coefficient": ""}
_MOST_ROWS = 100_000
_APART = 0.05
"""Largest distance of a row from the mean of its slip speed, relative to the largest coefficient."""
_SLOWEST = 0.1
"""Largest slip speed of the slowest row, relative to the fastest one, in a table without a row at 0."""


def with_table(values: dict[str, object], folder: Path) -> dict[str, object]:
    """Return scene values with `friction.table`, a file relative to `folder`, replaced by its table.

    Rows with an empty cell are left out. Rows of both directions count by the amounts of slip speed and coefficient,
    where the coefficients of one direction have the sign of the slip speed or all are above 0. Rows are sorted, and
    those of one slip speed are averaged. Without a row at 0, the coefficient of the slowest row holds down to 0.

    Raises InputError: the file cannot be read or has other columns, a coefficient has the wrong sign, rows of one slip
    speed differ by more than 5 % of the largest coefficient from their mean, the slowest row is far from 0, or the
    values have a table already.
    """
    if TABLE_FILE not in values:
        if TABLE_COLUMNS in values:
            raise InputError(f"{TABLE_COLUMNS} names columns of {TABLE_FILE}, which is not given")
        return values
    for key in TABLE:
        if key in values:
            raise InputError(f"{TABLE_FILE} and {key} are both given; remove one of them")
    columns = values.get(TABLE_COLUMNS)
    try:
        table = _table_in(folder / str(values[TABLE_FILE]), None if columns is None else str(columns))
    except InputError as error:
        raise InputError(f"{TABLE_FILE}: {error}") from None
    return {**{key: value for key, value in values.items() if key not in (TABLE_FILE, TABLE_COLUMNS)},
            **dict(zip(TABLE, table))}


def _table_in(path: Path, names: str | None) -> tuple[list[float], list[float]]:
    """Return slip speeds, rising from 0, and coefficients of a file."""
    import numpy as np  # Few scenes have such a file.

    from tcc_sim.tables.chosen_columns import columns_in

    columns, _, _ = columns_in(path, _COLUMNS, list(_COLUMNS), _MOST_ROWS, names, TABLE_COLUMNS)
    speed, coefficient = (columns[name] for name in _COLUMNS)
    rows = np.flatnonzero(np.isfinite(speed) & np.isfinite(coefficient))
    if not len(rows):
        raise InputError(f"{path} has no row with a slip speed and a coefficient")
    speed, coefficient = speed[rows], coefficient[rows]
    wrong = coefficient * speed < 0.0
    if (coefficient < 0.0).any() and wrong.any():
        k = int(np.flatnonzero(wrong)[0])
        raise InputError(f"{path}: row {rows[k] + 1} has a coefficient of {coefficient[k]:g} at {speed[k]:g} rad/s; "
                         "coefficients must be above 0, or have the sign of the slip speed")
    coefficient = np.abs(coefficient)
    speeds, place = np.unique(np.abs(speed), return_inverse=True)
    means = np.bincount(place, coefficient) / np.bincount(place)
    apart = np.abs(coefficient - means[place]) / coefficient.max()
    if apart.max() > _APART:
        k = int(apart.argmax())
        raise InputError(f"{path}: row {rows[k] + 1} has a coefficient of {coefficient[k]:g}, and the mean of the rows "
                         f"at {abs(speed[k]):g} rad/s is {means[place[k]]:g}; they may differ by {_APART:.0%} of the "
                         "largest one")
    if speeds[0] > _SLOWEST * speeds[-1]:
        raise InputError(f"{path}: the slowest row has {speeds[0]:g} rad/s; without a row at 0 it must have at most "
                         f"{_SLOWEST:.0%} of the fastest one, {_SLOWEST * speeds[-1]:g} rad/s")
    first = [0.0] if speeds[0] > 0.0 else []
    return [*first, *speeds.tolist()], [*(means[:1].tolist() if first else []), *means.tolist()]


DEFAULT_SCENE, NODE_SCENE = "fig02", "commands"
"""Default scene of the driveline, and of the driveline node, which accepts commands and runs without them too."""
LONGEST_VALUE = 4000
"""Longest value on the command line, characters; the longest list of harmonics needs fewer than 1000."""


@dataclass(frozen=True)
class Operation(Options):
    """Options of the driveline node that are not physics: rate, pacing, topics, threads."""

    rate: float = quantity(1000.0, "tick rate of the physics and of the topics", "Hz", 1.0, 20000.0)
    real_time_factor: float = quantity(1.0, "simulated seconds per second of real time; 0 is as fast as possible", "",
                                       0.0, 1000.0, live=True)
    pacing: str = quantity("real_time", "condition for the next tick: its deadline, or the command that answers the "
                           "last tick", choices=("real_time", "lockstep"))
    command_timeout: float = quantity(0.5,
                                      "without a command for this long in simulated time the input falls back (see "
                                      "engine.fallback and pressure.fallback); 0 never falls back", "s", 0.0, 1e6,
                                      live=True)
    command_period: float = quantity(0.0, "time between two answers that lock-step waits for, whole ticks; 0 is every "
                                     "tick", "s", 0.0, 10.0)
    wait_for_subscribers: int = quantity(0, "subscribers of joint_states to wait for before the first tick", "", 0,
                                         1000)
    publish_scalars: bool = quantity(True, "publish slip_speed, friction_torque and stick_slip_state")
    stamp: str = quantity("simulation", "stamps: simulation time, from 0, or that plus the wall clock's time at the "
                          "first tick, and from a reset on at that of the reset",
                          choices=("simulation", "wall"))
    publish_stamped: bool = quantity(False, "publish slip_speed_stamped and friction_torque_stamped, with the stamp of "
                                     "joint_states")
    publish_shaft_torque: bool = quantity(False, "publish shaft_torque, for a vehicle that answers with output_speed")
    publish_diagnostics: bool = quantity(True, "publish /diagnostics at 1 Hz")
    publish_clock: bool = quantity(False, "publish /clock, unless another node does; in lock-step it is published "
                                  "anyway if a node with use_sim_time listens")
    thread_priority: int = quantity(0, "SCHED_FIFO priority of the real-time thread, one less for the others; 0: none",
                                    "", 0, 99)
    cpu_affinity: tuple[int, ...] = quantity((), "cores that the real-time thread may run on; empty: all", "", 0, 1023)
    lock_memory: bool = quantity(False, "lock the memory of the process, so that no page fault delays it")

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.command_period * self.rate + 1e-6) % 1.0 > 2e-6:
            raise InputError(f"command_period is {self.command_period:g} s; it must be a whole number of ticks of "
                             f"{1.0 / self.rate:g} s")

    @property
    def answer_ticks(self) -> int:
        """Ticks between two commands for which lock-step waits."""
        return max(1, round(self.command_period * self.rate))


OPERATION_QUANTITIES = Operation.quantities()
"""Node options of a scene file, with their meanings."""

MEANINGS: dict[str, Quantity] = {**parameters.QUANTITIES, **OPERATION_QUANTITIES}
"""Scene keys and node options, with their meanings."""
KNOWN_KEYS = list(MEANINGS)


@dataclass(frozen=True)
class Scene:
    """A validated scene: name, physical system, options of the driveline node, and description.

    Examples
    --------
    >>> import tcc_sim
    >>> scene = tcc_sim.load_scene("fig02").with_values({"engine.frequency": 120.0})
    >>> scene.system.engine.frequency
    120.0
    """

    name: str
    system: System
    operation: Operation = field(default_factory=Operation)
    description: str = ""
    unused: tuple[str, ...] = field(default=(), compare=False)
    """Keys that were given together with a friction table, which replaces them."""
    notes: tuple[str, ...] = field(default=(), compare=False)
    """Further warnings."""

    def warnings(self) -> list[str]:
        """Return the warnings about the scene that accompany every result."""
        friction = self.system.friction
        unused = self.unused if friction.curve is not None else ()
        return [*(f"{key} is not used, because the friction table replaces it" for key in unused), *friction.doubts,
                *self.notes]

    def __post_init__(self) -> None:
        delay_ticks(self.system.pressure, 1.0 / self.operation.rate)

    def with_values(self, values: Mapping[str, object]) -> Scene:
        """Return this scene with some keys changed; the new values are checked together.

        Raises
        ------
        InputError
            A key is unknown (the message suggests the nearest one), a type is wrong, or a value is out of range.
        """
        model = {k: v for k, v in values.items() if k not in OPERATION_QUANTITIES}
        options: dict[str, Any] = {k: v for k, v in values.items() if k in OPERATION_QUANTITIES}
        for key in model:
            meaning_of(key)
        unused = tuple(key for key in TABULATED if key in values) if values.get(TABLE[0]) else self.unused
        return dataclasses.replace(self, system=parameters.replace(self.system, model), unused=unused,
                                   operation=dataclasses.replace(self.operation, **options))

    def with_changes(self, values: Mapping[str, object]) -> Scene:
        """Return this scene with the keys that a command gives: as `with_values`, but a constant beside the profile
        that replaces it, which a scene file may have, is refused.
        """
        for key in values:
            if f"{key}_times" in values:
                raise InputError(f"{key} and {key}_times are both given, and the profile replaces {key}; remove one of "
                                 "them")
        return self.with_values(values)

    def values(self) -> dict[str, Any]:
        """Return every scene key and node option with its value."""
        return {**dict(parameters.values_of(self.system)), **vars(self.operation)}

    def value(self, key: str) -> object:
        """Return the value of a scene key or of a node option.

        Raises
        ------
        InputError
            The key is unknown; the message suggests the nearest one.
        """
        meaning_of(key)
        if key == SPEED:
            return self.system.engine.frequency / self.system.engine.order
        group, _, name = key.rpartition(".")
        return getattr(getattr(self.system, group) if group else self.operation, name)

    def text(self) -> str:
        """Return the text of a parameter file with every key; reading it gives exactly the same scene."""
        tree: dict[str, Any] = {}
        tabulated = TABULATED if self.system.friction.curve is not None else ()
        speeds = {frequency_key(key): (key, speed) for key, speed in self.system.speeds.items()}
        for key, value in self.values().items():
            if f"{SPEED}_values" in self.system.speeds and key == f"{FREQUENCY}_times":
                key = f"{SPEED}_times"
            key, value = speeds.get(key, (key, value))
            group, _, name = key.rpartition(".")
            # ROS 2 cannot read an empty list, the default; a friction table replaces some keys.
            if value != () and not (key in tabulated and value == parameters.DEFAULTS[key]):
                place = tree.setdefault(group, {}) if group else tree
                place[name] = list(value) if isinstance(value, tuple) else value
        body = dumped({"/**": {"ros__parameters": tree}})
        return f"# {self.description or self.name}\n{body}"

    def _repr_html_(self) -> str:
        """Return the view in a notebook: every key with its value, unit and meaning."""
        values = self.values()
        table = {"key": list(values), "value": list(values.values()), "unit": [MEANINGS[key].unit for key in values],
                 "meaning": [MEANINGS[key].description for key in values]}
        return f"<p>{escape(self.name)}: {escape(self.description)}</p>{html_of(table, most=len(values))}"


def load_scene(name_or_file: str | Path) -> Scene:
    """Load a bundled scene by its name, or a scene file.

    Raises
    ------
    InputError
        The scene does not exist (the message suggests the nearest name), or the file is not a valid scene (the message
        names file, key, value and range).

    Examples
    --------
    >>> import tcc_sim
    >>> tcc_sim.load_scene("chaos").system.friction.law
    'smoothed'
    """
    bundled = bundled_scenes()
    text = str(name_or_file)
    path = bundled.get(text, Path(text))
    try:
        exists = text in bundled or path.is_file()
    except OSError as error:  # An impossible name, such as one that is too long.
        raise InputError(f"{path}: {error.strerror}") from None
    if not exists:
        looks_like_file = path.suffix in (".yaml", ".yml") or "/" in text
        near = difflib.get_close_matches(text, list(bundled), n=1, cutoff=0.4)
        hint = f"; did you mean {near[0]}?" if near and not looks_like_file else ""
        raise InputError(f"there is no scene {text!r}{hint or '; the bundled ones are ' + ', '.join(bundled)}")
    try:
        with path.open("rb") as stream:
            content = stream.read(LARGEST_FILE + 1)
        if len(content) > LARGEST_FILE:
            raise InputError(f"the file is larger than {LARGEST_FILE} bytes, the largest allowed for a scene")
        return parse_scene(content.decode("utf-8"), path.stem, path.parent)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: not a text file in UTF-8") from None
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


DRIVEN = {"engine_torque": ("engine.mean_torque", "engine.torque_amplitude", "engine.harmonic_"),
          "actuation_pressure": ("pressure.mean", "pressure.amplitude", "pressure.frequency_ratio", "pressure.phase")}
"""Beginnings of the keys that data replace, by input."""
SceneLike: TypeAlias = Scene | System | str | Path
"""A scene, its system, its name or its file, as public functions accept it."""


def system_of(scene: SceneLike) -> System:
    """Return the system of a scene, given as such, by name or file, or as a system.

    Raises InputError: as `load_scene`.
    """
    return scene if isinstance(scene, System) else as_scene(scene).system


def as_scene(scene: SceneLike) -> Scene:
    """Return a scene given as such, by name or file, or as a system, which gets the default node options.

    Raises InputError: as `load_scene`.
    """
    if isinstance(scene, System):
        return Scene("system", scene)
    return scene if isinstance(scene, Scene) else load_scene(scene)


def parse_scene(text: str, name: str, folder: Path = Path()) -> Scene:
    """Return the scene in the text of a parameter file; missing keys have their default values.

    `friction.table` names a table's file relative to `folder` that replaces friction.slip_speeds and .coefficients, and
    `friction.table_columns` names its columns.

    Raises InputError: the text is not a parameter file, or has a duplicate or unknown key, a wrong type, or a value out
    of range.
    """
    if len(text) > LARGEST_FILE:
        raise InputError(f"the text is longer than {LARGEST_FILE} characters, the most allowed for a scene")
    values = with_table(read_parameters(text), folder)
    return Scene(name, System(), Operation(), description_in(text)).with_values(values)


def meaning_of(key: str) -> Quantity:
    """Return the meaning of a scene key, of a number in a list (`KEY[n]`), or of a node option.

    Raises InputError: the key is unknown; the message suggests the nearest one.
    """
    known = {**MEANINGS, **DERIVED}
    if list_of(key) not in known:
        raise parameters.unknown_key(key, list(known))
    return known[list_of(key)]


def unused_beside(keys: Iterable[str], inputs: Iterable[str]) -> tuple[str, ...]:
    """Return a sentence for each key of a command that belongs to one of the inputs, by topic, that come from data."""
    return tuple(f"{key} is not used, because the data have {name}" for key, name in itertools.product(keys, inputs)
                 if key.startswith(DRIVEN.get(name, ())))


def parse_assignments(assignments: list[str]) -> dict[str, object]:
    """Return the scene values in KEY=VALUE words of a command line; each value is read as YAML.

    Raises InputError: a word has no '=', a value is unreadable, or a key is unknown.
    """
    import yaml

    values: dict[str, object] = {}
    for word in assignments:
        key, equals, value = word.partition("=")
        if not equals or not key or not value:
            raise InputError(f"{word!r} is not KEY=VALUE")
        if key not in (TABLE_FILE, TABLE_COLUMNS):
            meaning_of(key)
        if key in values:
            raise InputError(f"{key} is given twice")
        if len(value) > LONGEST_VALUE:
            raise InputError(f"{key}: a value of {len(value)} characters; at most {LONGEST_VALUE} are allowed")
        try:
            values[key] = yaml.safe_load(value)
        except (yaml.YAMLError, ValueError, RecursionError):
            raise InputError(f"{key}: {value!r} is not a number, a word or a list") from None
    return with_table(values, Path())


def parse_profiles(words: list[str]) -> dict[str, object]:
    """Return the values of KEY_times and KEY_values in KEY=T:V,T:V words of a command line.

    Raises InputError: a key cannot have a profile or is given twice, or a point is not two numbers.
    """
    values: dict[str, object] = {}
    for word in words:
        key, _, points = word.partition("=")
        if list_of(key) not in (*PROFILES, SPEED) or key == "engine.harmonic_amplitudes":
            raise InputError(f"--profile {word[:100]}: the keys that have a profile are {PROFILED} and {SPEED}")
        if f"{key}_times" in values:
            raise InputError(f"--profile {key} is given twice")
        try:
            unit = meaning_of(key).unit
            pairs = [(float(time), number_in(value, unit)) for time, value in (
                point.split(":") for point in points.split(","))]
        except (ValueError, TypeError):
            pairs = []
        refuse_rpm(key, [point.partition(":")[2] for point in points.split(",")])
        if not pairs:
            raise InputError(f"--profile {word[:100]} is not KEY=TIME:VALUE,TIME:VALUE,... in s and the key's unit")
        values[f"{key}_times"], values[f"{key}_values"] = map(list, zip(*pairs))
    return values


__all__ = ["DEFAULT_SCENE", "KNOWN_KEYS", "NODE_SCENE", "Operation", "Scene", "bundled_scenes", "load_scene",
           "parse_assignments", "parse_profiles", "parse_scene", "system_of"]
