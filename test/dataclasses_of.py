"""The dataclasses of a room."""

from __future__ import annotations

import dataclasses
from importlib import import_module
from pkgutil import iter_modules


def changeable(room: str) -> list[str]:
    """Names of the dataclasses of a room whose fields can be set."""
    names = [f"tcc_sim.{room}.{found.name}" for found in iter_modules(import_module(f"tcc_sim.{room}").__path__)]
    kinds = {kind for name in names for kind in vars(import_module(name)).values() if isinstance(kind, type)
             and dataclasses.is_dataclass(kind) and kind.__module__ == name}
    assert kinds
    return sorted(kind.__name__ for kind in kinds if not kind.__dataclass_params__.frozen)
