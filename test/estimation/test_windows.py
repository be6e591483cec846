"""The windows of multiple shooting: their inputs, their starts, and the length of a step."""

from __future__ import annotations

import math

import numpy as np
import pytest
from fig02_measured import FIG02, KEYS, measured, moved

from tcc_sim.errors import NumericalFailure
from tcc_sim.estimation.identify import identify
from tcc_sim.estimation.measurement import Measurement
from tcc_sim.estimation.multiple_shooting import MultipleShooting
from tcc_sim.estimation.settings import DEFAULTS, FitSettings, Stage
from tcc_sim.estimation.windows import Model, sensitivities, states_of

STATIC, KINETIC = list(KEYS)[:2]


def problem(keys: tuple[str, ...], window: float = 0.01) -> MultipleShooting:
    data, noise = measured(0, 0.2)
    return MultipleShooting(Model(FIG02.system, keys, data), noise, FitSettings(), window)


def test_the_offset_of_a_pressure_is_what_its_sensor_shows_too_much() -> None:
    t, states, _ = moved(0.2)
    pressure = FIG02.system.pressure
    shown = pressure.mean + pressure.amplitude * np.sin(FIG02.system.engine.frequency * t) + 5e3
    rng = np.random.default_rng(9)
    channels = {"slip_speed": states[:, 0] + 0.2 * rng.standard_normal(len(t)),
                "plate_speed": states[:, 2] + 0.2 * rng.standard_normal(len(t))}
    result = identify(Measurement(t, channels, {"actuation_pressure": shown}), ["actuation_pressure.offset"],
                      scene=FIG02, noise={"slip_speed": 0.2, "plate_speed": 0.2}, hold="linear").parameters[0]
    assert result.value == pytest.approx(5e3, abs=4.0 * result.standard_error)
    assert result.standard_error < 500.0


@pytest.mark.parametrize(("key", "other"), [(STATIC, 0.24), (KINETIC, 0.3)])
def test_a_coefficient_that_is_free_alone_stays_on_its_side(key: str, other: float) -> None:
    """Which is that of the fixed one of the scene, whichever it is."""
    of, value = problem((key,)), KEYS[key]
    towards = -1.0 if key == STATIC else 1.0
    at_bound = other * DEFAULTS.least_ratio ** -towards
    assert of._moved(np.array([value]), np.array([10.0 * towards])) == pytest.approx([at_bound], rel=1e-12)
    free = value * math.exp(-0.1 * towards)
    assert of._moved(np.array([value]), np.array([-0.1 * towards])) == pytest.approx([free], rel=1e-12)


def test_both_coefficients_keep_their_order_from_where_they_are() -> None:
    of = problem((STATIC, KINETIC))
    falling, rising = np.array([0.3, 0.24]), np.array([0.24, 0.3])
    for values, steps, ratio in ((falling, [-0.3, 0.3], DEFAULTS.least_ratio), (rising, [0.3, -0.3],
                                                                               1.0 / DEFAULTS.least_ratio)):
        moved_on = of._moved(values, np.array(steps))
        assert moved_on[0] / moved_on[1] == pytest.approx(ratio, rel=1e-12)


def test_states_that_are_no_numbers_are_a_failure() -> None:
    model = problem((STATIC,)).model
    for start in (math.nan, math.inf):
        with pytest.raises(NumericalFailure, match="not finite"):
            states_of(model, np.array([[start, 0.1, 0.0]]), 10, np.array([0.3]), 20)


def test_states_alone_need_no_derivatives(monkeypatch: pytest.MonkeyPatch) -> None:
    model, by = problem((STATIC,)).model, []
    monkeypatch.setattr("tcc_sim.estimation.windows.advance_windows",
                        lambda *given: by.append(given[-1].shape[1]) or (np.zeros((1, 11, 3)), None))
    states_of(model, np.zeros((1, 3)), 10, np.array([0.3]), 20)
    sensitivities(model, np.zeros((1, 3)), 10, np.array([0.3]), 20)
    assert by == [0, 1]


def test_windows_begin_again_in_robust_stages_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the window before ends, if that costs less; in the last stages they are one motion already."""
    of, seen = problem((STATIC,)), []
    values, starts = np.array([0.3]), problem((STATIC,)).first_starts(np.array([0.3]))
    monkeypatch.setattr(of, "_mended", lambda values, starts, *rest: seen.append(len(starts)) or starts)
    for robust, calls in ((math.inf, 0), (4.0, 1)):
        seen.clear()
        of.descend(values, starts, Stage(0.01, 1.0, 1e-2, 1, robust), None)
        assert len(seen) == calls


def test_starts_in_stick_are_held_in_early_stages_only() -> None:
    of = problem((STATIC,))
    assert len(of.stuck) > 0
    assert [len(of._held(stage.weight)) > 0 for stage in FitSettings().stages] == [True] * 3 + [False] * 3


def test_a_start_that_is_far_off_begins_where_the_window_before_ends() -> None:
    of, truth = problem((STATIC,)), moved(0.2)[1][::10]
    values, n = np.array([0.3]), problem((STATIC,)).model.substeps(np.array([0.3]))
    starts = truth.copy()
    starts[7] += [8.0, 0.02, 5.0]
    states = states_of(of.model, starts, of.width, values, n)
    mended = of._mended(values, starts, states, 1.0, n)
    assert mended[7] == pytest.approx(states[6, -1])
    assert mended[7] == pytest.approx(truth[7], abs=1e-2)
    assert mended[0] == pytest.approx(starts[0])
