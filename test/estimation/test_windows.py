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
from tcc_sim.estimation.settings import FitSettings
from tcc_sim.estimation.windows import Model, states_of

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


def test_states_that_are_no_numbers_are_a_failure() -> None:
    model = problem((STATIC,)).model
    for start in (math.nan, math.inf):
        with pytest.raises(NumericalFailure, match="not finite"):
            states_of(model, np.array([[start, 0.1, 0.0]]), 10, np.array([0.3]), 20)
