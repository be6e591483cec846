"""A message that is absent is unknown, and changes no figure beyond what it hides: topics x absences x figures.

The truth comes from the ticks at which every topic is there, by sums over them.
"""

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driveline_bags import TICK, bag, readings

from tcc_sim.cli import main
from tcc_sim.messages import cdr
from tcc_sim.scene import load_scene
from tcc_sim.topics import FLUID_PRESSURE

SCENE = load_scene("controlled").with_values({"engine.source": "harmonic"})
TICKS, LAST = 1101, 0.4
"""Number of ticks, and time from which the figures count, s: the start is dropped."""
TOPICS = "joint_states", "applied_pressure", "output_state", "actuation_pressure"
ABSENCES: dict[str, Callable[[], np.ndarray]] = {
    "none": lambda: np.zeros(TICKS, np.bool_),
    "one": lambda: np.arange(TICKS) == 900,
    "2 %": lambda: (np.random.default_rng(2).random(TICKS) < 0.02) & (np.arange(TICKS) > 60),
    "gap": lambda: (np.arange(TICKS) >= 800) & (np.arange(TICKS) < 900),
}


def pressure(k: int) -> float:
    return 1.1e5 + 2e4 * np.sin(1e-2 * k)


def speed(k: int) -> float | None:
    return 8.0 * np.sin(4e-3 * k) if k > 50 else None


@cache
def run() -> tuple[list[tuple], list[tuple]]:
    """Rows of a driveline under moving pressure, and of its shaft's far end, which moves from tick 51 on."""
    return readings(SCENE, TICKS, pressure, speed)


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, str], Any]:
    @cache
    def result(topic: str, absence: str) -> Any:
        folder, gone = tmp_path_factory.mktemp("absent"), ABSENCES[absence]()
        rows, ends = run()
        absent = {TICK * k for k in np.flatnonzero(gone).tolist()}
        sent = {k: [("/actuation_pressure", FLUID_PRESSURE, 10**18 + k * TICK + 5, 10**18 + k * TICK + 5,
                     cdr.fluid_pressure(k * TICK, pressure(k + 1)))] for k in range(TICKS - 1)
                if not (topic == "actuation_pressure" and k * TICK in absent)}
        kept = [row for row in rows if not (topic == "joint_states" and row[0] in absent)]
        path = bag(folder / "run", kept, SCENE, clock=lambda k: 10**18 + kept[k][0], joined=sent,
                   unpressed=absent if topic == "applied_pressure" else (),
                   ends=[row for row in ends if not (topic == "output_state" and row[0] in absent)])
        status = main(["analyse", str(path), "--verify", "--discard", "0", "--from", str(LAST), "--json",
                       str(folder / "j"), "--out", str(folder / "run.npz")])
        hidden = gone if topic in ("joint_states", "output_state") else np.zeros(TICKS, np.bool_)
        return (json.loads(Path(folder / "j").read_text()), dict(np.load(folder / "run.npz")), status, Truth(hidden))
    # Without an absence the recording is the same whatever the topic.
    return lambda topic, absence: result(TOPICS[0] if absence == "none" else topic, absence)


class Truth:
    """Figures from the ticks at which all is known, from LAST on."""

    def __init__(self, hidden: np.ndarray) -> None:
        table = np.array(run()[0])
        far = np.zeros((TICKS, 4))
        far[51:] = np.array(run()[1])[-(TICKS - 51):]
        inside = ~hidden & (table[:, 0] * 1e-9 >= LAST - 1e-9)
        self.t, steps = table[inside, 0] * 1e-9, np.diff(np.flatnonzero(inside))
        angle, flywheel, plate, _, friction = table[inside, 2:7].T
        self.v, driveline = flywheel - plate, SCENE.system.driveline
        self.shaft = driveline.stiffness * (angle - far[inside, 1]) + driveline.damping * (plate - far[inside, 2])
        self.power = friction * self.v
        self.heat = float((0.5e-3 * (self.power[1:] + self.power[:-1]))[steps == 1].sum())
        self.lost = float(steps[steps > 1].sum() * 1e-3)


def reached(value: float, samples: np.ndarray) -> bool:
    """No sample lies above a figure, and it is not far above: tops lie between samples."""
    return bool(samples.max() - 1e-9 <= value <= samples.max() + 0.02 * np.ptp(samples))


FIGURES: dict[str, Callable[[Any, Truth], bool]] = {
    "max_slip_speed": lambda s, t: reached(s["max_slip_speed"], np.abs(t.v)),
    "min_slip_speed": lambda s, t: reached(-s["min_slip_speed"], -t.v),
    "clutch_energy": lambda s, t: s["clutch_energy"] == pytest.approx(t.heat, rel=0.02),
    "mean_power": lambda s, t: s["mean_power"] == pytest.approx(t.heat / (1.1 - LAST - t.lost), rel=0.02),
    "peak_power": lambda s, t: reached(s["peak_power"], t.power),
    "max_shaft_torque": lambda s, t: reached(s["max_shaft_torque"], t.shaft),
    "min_shaft_torque": lambda s, t: reached(-s["min_shaft_torque"], -t.shaft),
    "lost_seconds": lambda s, t: s["lost_seconds"] == pytest.approx(t.lost, abs=1e-9),
    "seconds": lambda s, t: s["seconds"] == pytest.approx(1.1 - LAST - t.lost, abs=1e-9),
}


@pytest.mark.parametrize("absence", ABSENCES)
@pytest.mark.parametrize("topic", TOPICS)
def test_figures_are_sums_over_what_is_there(results: Any, topic: str, absence: str) -> None:
    summary, samples, status, truth = results(topic if absence != "none" else TOPICS[0], absence)
    assert not {name: summary[name] for name, right in FIGURES.items() if not right(summary, truth)}, vars(truth)
    assert np.isfinite(np.stack([samples[name] for name in ("slip_speed", "plate_angle", "plate_speed", "engine_torque",
                                                            "friction_torque", "output_angle", "output_speed")])).all()
    assert samples["t"] == pytest.approx(truth.t, abs=1e-12)
    known = absence == "none" or topic in ("actuation_pressure", "joint_states")
    assert (status == 0, summary["verified"]) == (known, known)
    assert summary["largest_difference"] < 1e-6, summary["verification"]


def test_held_states_the_far_end_of_which_messages_are_absent(tmp_path: Path) -> None:
    rows, ends = run()
    gone = ABSENCES["2 %"]()
    path = bag(tmp_path / "run", rows, SCENE, named=True, far=ends, ends=[
        row for row in ends if not gone[row[0] // TICK]])
    assert main(["analyse", str(path), "--out", str(tmp_path / "run.npz"), "--discard", "0"]) == 0
    samples = np.load(tmp_path / "run.npz")
    told = samples["t"] * 1e9 >= ends[0][0] - 1
    for place, name in ((1, "output_angle"), (2, "output_speed")):
        np.testing.assert_allclose(samples[name][told], [row[place] for row in ends], atol=1e-12)
