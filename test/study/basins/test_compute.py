"""Planes of basins: refused ones, their cells and seeds, and when slip runs away."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tcc_sim.errors import InputError
from tcc_sim.model.parameters import System, replace
from tcc_sim.study.basins.compute import DrivelineMotion, basins, check_plane
from tcc_sim.study.basins.results import Axis

V, ANGLE, SPEED = "initial.slip_speed", "initial.plate_angle", "initial.plate_speed"
RUNNING_AWAY = {"pressure.mean": 150e3, "friction.kinetic_coefficient": 0.15, "pressure.amplitude": 0.0}
"""Tsm = 180 N m holds less than Tm = 300 N m."""


PLANE = [(V, (0.0,)), (ANGLE, (0.0,))]


@pytest.mark.parametrize(("plane", "how", "words"), [
    ([(V, (1.0,))], {}, ("2", "1")), ([(V, (1.0,))] * 3, {}, ("2", "3")),
    ([(V, (1.0,)), ("initial.plate_anle", (1.0,))], {}, ("initial.plate_anle", "initial.plate_angle?")),
    ([("engine.frequency", (1.0,)), (V, (1.0,))], {}, ("engine.frequency", V, ANGLE, SPEED)),
    ([(V, (1.0,)), (V, (2.0,))], {}, (V,)), ([(V, ()), (ANGLE, (0.0,))], {}, ("0", "1 to 4000000")),
    ([(V, range(2000)), (ANGLE, range(2001))], {}, ("4002000", "1 to 4000000")),
    ([3.0, (V, (1.0,))], {}, ("3.0",)), ([(V,), (V, (1.0,))], {}, (V,)), ([(V, ["x"]), PLANE[1]], {}, (V, "x")),
    (PLANE, {"cycles": 15}, ("cycles", "15", "16 to 1000000")),
    (PLANE, {"cycles": 1_000_001}, ("cycles", "1000001", "16 to 1000000")),
    (PLANE, {"over": (V, (1.0,))}, ("over", V)), (PLANE, {"over": (ANGLE, (1.0,))}, ("over", ANGLE)),
    (PLANE, {"over": "engine.frequency"}, ("engine.frequency",)), (PLANE, {"jobs": 0}, ("jobs", "0", "1 to 1024")),
    (PLANE, {"over": ("pressure.frequency_ratio", (1.0, 2.0**0.5))}, ("pressure.frequency_ratio", "1.41421"))])
def test_a_plane_or_a_calculation_that_is_none_is_refused_without_a_file(plane: Any, how: Any, words: tuple[str, ...],
                                                                         tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        basins("fig02", plane, part=tmp_path / "b.part", **how)
    assert all(word in str(error.value) for word in words), str(error.value)
    assert list(tmp_path.iterdir()) == []


def test_a_plane_is_given_by_axes_or_by_keys_and_values_of_any_type() -> None:
    axes = Axis(V, (0.0, 50.0)), Axis(ANGLE, (0.0, 0.1))
    assert check_plane(axes) == check_plane([(V, np.array([0, 50])), (ANGLE, [0.0, 0.1])]) == axes
    assert len(check_plane([(V, range(2000)), (SPEED, range(2000))])[1].values) == 2000


@pytest.mark.parametrize(("changes", "away"), [
    ({}, True), ({"engine.mean_torque": 180.0}, False), ({"engine.mean_torque": 180.1}, True),
    ({"friction.decay": 0.0, "friction.static_coefficient": 0.25}, False),  # mu_s Pm A R = 300 N m at any slip speed.
    ({"friction.decay": 0.0, "friction.static_coefficient": 0.2499}, True),
    ({"converter.coupling": 0.05}, False)])
def test_slip_runs_away_where_the_mean_torque_exceeds_what_the_clutch_carries(changes: Any, away: bool) -> None:
    motion = DrivelineMotion(replace(System(), {**RUNNING_AWAY, **changes}))
    assert motion.runs_away(np.array([[1e6, 0.0, 0.0]])).tolist() == [away]


def test_the_largest_slip_of_a_motion_has_either_sign() -> None:
    """From rest slip grows one way; the mirrored engine, half a period later, makes it grow the other way."""
    half = {"engine.harmonic_amplitudes": (), "engine.mean_torque": 0.0, "pressure.mean": 5e4}
    system = replace(System(), {**RUNNING_AWAY, **half})
    speeds = [DrivelineMotion(system).largest(np.array([v, 0.0, 0.0]), first, 1) for v, first in
              ((500.0, 0), (-500.0, 3))]
    assert speeds[0] > speeds[1] == pytest.approx(500.0, abs=1e-6)
