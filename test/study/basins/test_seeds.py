"""Branches from the attractors that basins found: both coexisting motions at once, and refused documents."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tcc_sim.cli import main
from tcc_sim.errors import InputError, NumericalFailure
from tcc_sim.scene import load_scene
from tcc_sim.study.continuation.motions import ContinuationPlan, Seed, continue_motions, seeds_in

MU_K = "friction.kinetic_coefficient"
CHANGES = {"pressure.mean": 225e3, "pressure.amplitude": 0.0, MU_K: 0.255,
           "engine.frequency": 0.36 * load_scene("fig02").system.natural_frequency}
SCENE = ["fig02", *(word for key, value in CHANGES.items() for word in ("--set", f"{key}={value!r}"))]
SYSTEM = load_scene("fig02").with_values(CHANGES).system


@pytest.fixture(scope="module")
def document(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file: Path = tmp_path_factory.mktemp("basins") / "basins.json"
    plane = ["--plane", "initial.slip_speed=0:120:4", "--plane", "initial.plate_angle=-0.1:0.3:3"]
    assert main(["basins", *SCENE, *plane, "--json", str(file)]) == 0
    return file


def test_both_attractors_of_a_plane_are_followed(document: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "branches.json"
    assert main(["continue", *SCENE, "--over", f"{MU_K}=0.25:0.26", "--seeds", str(document), "--json", str(out)]) == 0
    result = json.loads(out.read_text())
    attractors = json.loads(document.read_text())["attractors"]
    assert sorted(b["period"] for b in result["branches"]) == [1, 2]
    for branch in result["branches"]:
        assert branch["origin"]["kind"] == "attractor"
        attractor = attractors[branch["origin"]["attractor"]]
        assert branch["origin"]["value"] == 0.255
        at = branch["value"].index(0.255)
        assert branch["period"] == attractor["period"]
        assert branch["max_slip_speed"][at] == pytest.approx(attractor["max_slip_speed"], abs=1e-4)
        assert branch["stable"][at]
        assert (min(branch["value"]), max(branch["value"])) == pytest.approx((0.25, 0.26))
    assert "period 2" in capsys.readouterr().out


def test_a_seed_on_a_branch_that_is_known_begins_none(document: Path) -> None:
    seeds = seeds_in(json.loads(document.read_text()), SYSTEM, MU_K, 0.25, 0.26)
    result = continue_motions(SYSTEM, ContinuationPlan(MU_K, 0.25, 0.26, seeds=(*seeds, *seeds)))
    assert [b.period for b in result.branches] == [s.period for s in seeds]
    (only,) = continue_motions(SYSTEM, ContinuationPlan(MU_K, 0.25, 0.26, period=1, seeds=seeds)).branches
    assert only.period == 1
    with pytest.raises(NumericalFailure, match="period 3"):
        continue_motions(SYSTEM, ContinuationPlan(MU_K, 0.25, 0.26, period=3, seeds=seeds))
    with pytest.raises(InputError, match=r"0\.26 to 0\.27"):
        ContinuationPlan(MU_K, 0.26, 0.27, seeds=seeds)


def changed(document: Path, **values: Any) -> dict[str, Any]:
    by_name: dict[str, Any] = {**json.loads(document.read_text()), **values}
    return by_name


def test_attractors_along_a_key_are_seeds_at_its_values(document: Path) -> None:
    attractors = changed(document)["attractors"]
    several = changed(document, over=MU_K, values=[0.24, 0.255, 0.3], attractors=[[], attractors, attractors])
    assert {s.value for s in seeds_in(several, SYSTEM, MU_K, 0.24, 0.26)} == {0.255}
    assert seeds_in(several, SYSTEM, MU_K, 0.28, 0.3)[0] == Seed(0.3, tuple(attractors[0]["state"]),
                                                                attractors[0]["period"])


@pytest.mark.parametrize(("values", "word"), [
    ({"format": "tcc_sim sweep 1"}, "basins"), ({"format": None}, "basins"),
    ({"over": "pressure.mean", "values": [1.0]}, "pressure.mean"), ({"attractors": [{}]}, ""), ({"attractors": 3}, ""),
    ({"scene": {}}, ""), ({"attractors": []}, ""), ({"attractors": [{"period": 0}]}, ""),
    ({"attractors": [{"period": 1, "state": [1.0, None, 2.0]}]}, "")])
def test_what_is_no_document_of_basins(values: dict[str, Any], word: str, document: Path) -> None:
    with pytest.raises(InputError, match=word or None):
        seeds_in(changed(document, **values), SYSTEM, MU_K, 0.25, 0.26)


def test_wrong_seeds_are_one_line_and_status_2(document: Path, refused: Callable[..., str], tmp_path: Path) -> None:
    over = ["--over", f"{MU_K}=0.25:0.26"]
    for name, text in (("none.json", None), ("text.json", "{"), ("list.json", "[1]"), ("deep.json", "[" * 100_000)):
        if text is not None:
            (tmp_path / name).write_text(text)
        assert name in refused("continue", *SCENE, *over, "--seeds", name, "--json", "out.json")
    words = ["--seeds", document, "--json", "out.json"]
    assert "engine.frequency = 139.4" in refused("continue", "fig02", *over, *words)
    assert MU_K in refused("continue", *SCENE, "--over", f"{MU_K}=0.26:0.27", *words)
