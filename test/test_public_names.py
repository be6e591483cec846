"""The public names of `import tcc_sim`, each with an example that runs."""

import doctest
import inspect
import re
from importlib import import_module
from pathlib import Path

import pytest

import tcc_sim
from tcc_sim import types

PACKAGE = Path(tcc_sim.__file__).parent
NAMES = [name for name in tcc_sim.__all__ if name != "__version__"]
KNOWN = {"Any", "Callable", "Literal", "Mapping", "None", "Path", "Sequence", "Answer", "Limits",
         "SceneLike", "State"}
EXAMPLES = sorted(".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__")
                  for path in PACKAGE.rglob("*.py") if ">>>" in path.read_text())


def test_the_package_shows_its_public_names():
    assert dir(tcc_sim) == sorted(tcc_sim.__all__)
    assert {"load_scene", "solve", "simulate", "sweep", "analyse", "plot", "Scene", "System", "Trajectory",
            "__version__"
            } <= set(dir(tcc_sim))
    assert len(dir(tcc_sim)) <= 26
    for name in NAMES:
        assert callable(getattr(tcc_sim, name)), name
    with pytest.raises(AttributeError, match="nothing"):
        tcc_sim.nothing  # noqa: B018


def test_the_types_of_results_are_exported():
    """Every class that a public function returns or takes is there by name."""
    assert dir(types) == sorted(types.__all__)
    for name in types.__all__:
        if name in ("Rig", "LockstepRun"):
            pytest.importorskip("rclpy", reason="rclpy is not installed")
        assert isinstance(getattr(types, name), type), name
    functions = [inspect.signature(getattr(tcc_sim, name)) for name in NAMES
                 if not isinstance(getattr(tcc_sim, name), type)]
    annotations = [str(one) for of in functions
                   for one in (of.return_annotation, *(entry.annotation for entry in of.parameters.values()))]
    assert set(re.findall(r"[A-Z][a-zA-Z]+", " ".join(annotations))) <= {*types.__all__, *NAMES, *KNOWN}


@pytest.mark.parametrize("name", NAMES)
def test_every_public_name_has_an_example(name):
    assert ">>>" in (getattr(tcc_sim, name).__doc__ or ""), name


@pytest.mark.parametrize("module", EXAMPLES)
def test_the_examples_run(module, tmp_path):
    if "plot" in module:
        pytest.importorskip("matplotlib")
    result = doctest.testmod(import_module(module), extraglobs={"folder": tmp_path},
                             optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    assert result.attempted > 0
    assert result.failed == 0


def test_a_file_and_a_system_are_scenes_for_a_law_and_for_a_transfer_function(tmp_path):
    scene = tcc_sim.load_scene("slip")
    file = tmp_path / "slip.yaml"
    file.write_text(scene.text())
    runs = [tcc_sim.closed_loop(x, lambda reading: None, 0.01) for x in ("slip", file, scene, scene.system)]
    assert len({run.slip_speed.tobytes() for run in runs}) == 1
    values = [tcc_sim.linearise(x, frequencies=[10.0]).response.tobytes() for x in ("slip", file, scene, scene.system)]
    assert len(set(values)) == 1
