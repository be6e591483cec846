"""Convert between ROS 2 parameters and a Scene: declare parameters, check overrides, warn of unknown ones."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from tcc_sim.errors import InputError
from tcc_sim.model.parameters import DERIVED, list_of, unknown_key
from tcc_sim.model.quantity import Options, Quantity
from tcc_sim.nodes.options import SCENE, TEXT
from tcc_sim.scene import DEFAULT_SCENE, KNOWN_KEYS, MEANINGS, NODE_SCENE, Scene, load_scene

Given = TypeVar("Given", bound=Options)
BUILT_IN = ("use_sim_time", "start_type_description_service")


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
    base = scene or load_scene(str(given.pop(SCENE, otherwise)))
    values = {name: without_arrays(value) for name, value in given.items()
              if name in DERIVED or list_of(name) in MEANINGS}
    warn_of_unknown(node, (SCENE, *KNOWN_KEYS, *DERIVED, *values))
    scene = base.with_values(values)
    if scene.system != base.system:
        scene = dataclasses.replace(scene, name=f"{base.name} with overrides",
                                    description=f"{base.description}, with overrides")
    text = ParameterDescriptor(read_only=True, description="the bundled scene or file that this node started from")
    node.declare_parameter(SCENE, base.name, text)
    for name, value in scene.values().items():
        _declare(node, name, value, MEANINGS[name])
    text = ParameterDescriptor(description="the scene with every override and change, as a parameter file; it cannot "
                                           "be set")
    node.declare_parameter(TEXT, scene.text(), text, ignore_override=True)
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
    low = min(meaning.low, 0.0) if meaning.zero else meaning.low
    descriptor = ParameterDescriptor(
        description=meaning.described, read_only=not meaning.live,
        additional_constraints="" if isinstance(value, bool) else meaning.interval(),
        # A live number also accepts an integer, as in scene files; ROS 2 gives an empty list another type.
        dynamic_typing=meaning.live)
    if isinstance(value, float):
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
