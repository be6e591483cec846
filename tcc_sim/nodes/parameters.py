"""Parameters of every node: their rows (name, unit, range, default), which `--help` and the page on nodes show too, and
their declaration, which checks overrides and warns of unknown ones; changes of a scene by parameters.

Only `_declare` imports ROS 2.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from tcc_sim.errors import InputError
from tcc_sim.model.parameters import DERIVED, list_of, unknown_key
from tcc_sim.model.quantity import Options, Quantity, quantity
from tcc_sim.plant.slip_control import Tuning
from tcc_sim.scene import DEFAULT_SCENE, KNOWN_KEYS, MEANINGS, NODE_SCENE, Operation, Scene, load_scene
from tcc_sim.topics import TOPICS

if TYPE_CHECKING:
    from rclpy.node import Node
    from rclpy.parameter import Parameter

Given = TypeVar("Given", bound=Options)
BUILT_IN = ("use_sim_time", "start_type_description_service")
SCENE, TEXT = "scene", "scene_text"
BESIDE = {SCENE: Quantity("the bundled scene or file that this node started from"),
          TEXT: Quantity("the scene with every override and change, as a parameter file; it cannot be set", live=True)}
"""Parameters of the driveline beside the scene's keys. The node updates the text after every change, so ROS 2 must not
take it for read-only.
"""


@dataclass(frozen=True)
class RecorderOptions(Options):
    """Parameters of the recorder."""

    output: str = quantity("", "directory to create for the recording; tcc_sim_ and the local time by default")
    topics: tuple[str, ...] = quantity(tuple(row.name for row in TOPICS), "topics to record")
    flush_period: float = quantity(0.25, "time between writes to the operating system, the most that a kill loses "
                                   "(plus 0.1 s)", "s", 0.0, 10.0, above=True)
    fsync_period: float = quantity(0.0, "time between writes to the disk, the most that a power cut loses (plus "
                                   "0.1 s); 0 leaves it to the operating system", "s", 0.0, 3600.0)
    max_bag_duration: float = quantity(3600.0, "longest duration of one file of the bag; 0 for no limit", "s", 1.0, 1e9,
                                       zero=True)
    max_bag_size: int = quantity(0, "largest size of one file of the bag; 0 for no limit", "bytes", 10_000, 1e18,
                                 zero=True)


OPTIONS: dict[str, type[Options]] = {"driveline": Operation, "recorder": RecorderOptions, "slip_controller": Tuning,
                                     "commander": Options}
"""Options of every node; the driveline also has the keys of a scene."""


def declare(node: Node, scene: Scene | None = None) -> Scene:
    """Declare every scene key and node option on `node`, with its overrides, and return the resulting scene.

    The overrides change `scene` if it is given, else the scene that they name, else NODE_SCENE. Overrides that set the
    source of an input, as the parameter file of a scene does, change DEFAULT_SCENE instead of NODE_SCENE.

    Raises InputError: the scene does not exist, or an override has a wrong type or is out of its range.
    """
    given = {name: parameter.value for name, parameter in overrides(node).items() if name not in BUILT_IN}
    if "friction.table" in given:
        raise InputError("friction.table works only in a scene file, with -p scene:=FILE; in a parameter file set "
                         "friction.slip_speeds and friction.coefficients")
    otherwise = DEFAULT_SCENE if {"engine.source", "pressure.source"} & given.keys() else NODE_SCENE
    named = given.pop(SCENE, None)
    base = scene or load_scene(str(otherwise if named is None else named))
    values = {name: without_arrays(value) for name, value in given.items()
              if name in DERIVED or list_of(name) in MEANINGS}
    warn_of_unknown(node, (SCENE, *KNOWN_KEYS, *DERIVED, *values))
    scene = base.with_values(values)
    if scene.system != base.system:
        scene = dataclasses.replace(scene, name=f"{base.name} with overrides",
                                    description=f"{base.description}, with overrides")
    beside = {SCENE: base.name if named is None else str(named), TEXT: scene.text()}
    for name, value in {**beside, **scene.values()}.items():
        _declare(node, name, value, BESIDE.get(name) or MEANINGS[name])
    return scene


def without_arrays(value: Any) -> Any:
    """Return a parameter's value for a scene; ROS 2 has no type for an empty list."""
    return [] if value is None else value.tolist() if hasattr(value, "tolist") else value


def overrides(node: Node) -> dict[str, Parameter]:
    """Return all parameters from a node's command line and parameter files, declared or not."""
    values: dict[str, Parameter] = node._parameter_overrides
    return values


def warn_of_unknown(node: Node, known: Iterable[str]) -> None:
    """Log a warning for each unknown parameter, with the nearest known name."""
    names = list(known)
    for name in sorted(set(overrides(node)) - {*names, *BUILT_IN}):
        node.get_logger().warning(f"parameter ignored: {unknown_key(name, names, 'one of this node')}")


def declared(node: Node, kind: type[Given], **otherwise: object) -> Given:
    """Declare every option of a node as a parameter, with its overrides, and return them; warn of unknown parameters.

    Raises InputError: a value has a wrong type or is out of its range.
    """
    meanings = kind.quantities()
    given = {name: without_arrays(one.value) for name, one in overrides(node).items() if name in meanings}
    options = kind(**{**otherwise, **given})
    for name, meaning in meanings.items():
        _declare(node, name, getattr(options, name), meaning)
    warn_of_unknown(node, meanings)
    return options


def _declare(node: Node, name: str, value: Any, meaning: Quantity) -> None:
    """Declare a parameter with a value that is checked already."""
    from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor

    low = min(meaning.low, 0.0) if meaning.zero else meaning.low
    descriptor = ParameterDescriptor(
        description=meaning.described, read_only=not meaning.live,
        additional_constraints="" if isinstance(value, bool) else meaning.interval(),
        # A live number also accepts an integer, as in scene files; ROS 2 gives an empty list another type.
        dynamic_typing=meaning.live)
    if isinstance(value, float) and meaning.high < math.inf:  # A tool's slider would have no end.
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=meaning.high, step=0.0)]
    elif isinstance(value, int) and not isinstance(value, bool):
        descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(meaning.high), step=1)]
    node.declare_parameter(name, list(value) if isinstance(value, tuple) else value, descriptor, ignore_override=True)


def changed(scene: Scene, parameters: list[Parameter]) -> Scene:
    """Return `scene` with the parameters of one request changed, checked together.

    Raises InputError: a value has a wrong type, is out of its range or conflicts with the others, or scene_text is
    changed.
    """
    if any(p.name == TEXT and p.value != scene.text() for p in parameters):
        raise InputError(f"{TEXT} follows the scene and cannot be set; set the keys of the scene instead")
    values = {p.name: without_arrays(p.value) for p in parameters if p.name in KNOWN_KEYS}
    after = scene.with_values(values)
    if (after.operation.real_time_factor == 0.0) != (scene.operation.real_time_factor == 0.0):
        raise InputError(f"real_time_factor is {after.operation.real_time_factor:g}; a running node cannot change to "
                         "or from 0")
    return after
