"""Nobody can change a result of the analyses."""

from dataclasses import is_dataclass
from importlib import import_module
from pkgutil import iter_modules

import tcc_sim.analysis
from tcc_sim.analysis.stream import RunCycles


def test_results_and_settings_are_frozen():
    """All dataclasses but the cycles of a run that is still read."""
    modules = [import_module(f"tcc_sim.analysis.{each.name}") for each in iter_modules(tcc_sim.analysis.__path__)]
    own = {kind for module in modules for kind in vars(module).values()
           if is_dataclass(kind) and isinstance(kind, type) and kind.__module__ == module.__name__}
    assert len(own) > 20
    assert {kind for kind in own if not kind.__dataclass_params__.frozen} == {RunCycles}
