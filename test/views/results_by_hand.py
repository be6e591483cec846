"""Small made-up results for pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tcc_sim.analysis.measured.orders import Judder, Orders, Spectrum
from tcc_sim.study.views import MARKS

ORBIT = {"number": 0, "period": 1, "max_slip_speed": 20.0, "section": [[0.1, 5.0]], "section_states": [[0.1, 5.0, 9.0]],
         "multipliers": None, "fraction": 0.75, "radius": 0.1, "state": [5.0, 0.1, 9.0]}
PLANE = {"plane": [{"key": "initial.slip_speed", "values": [0.0, 10.0]},
                   {"key": "initial.plate_speed", "values": [0.0, 10.0]}],
         "attractors": [ORBIT], "undecided": 0.25, "runaway": 0.0, "seconds": 1.0}
BRANCH = {"period": 1, "value": [0.2, 0.24, 0.3], "max_slip_speed": [30.0, 20.0, 10.0], "stable": [True, True, False]}
FOLD = {"kind": "fold", "value": 0.27, "max_slip_speed": 15.0, "branch": 0, "after": 1, "changes_stability": True}
BRANCHES = {"over": "friction.kinetic_coefficient", "branches": [BRANCH], "bifurcations": [
    FOLD, *({**FOLD, "kind": kind, "after": 0} for kind in MARKS)]}
CURVES = {**BRANCHES, "bifurcations": [FOLD], "second_over": "engine.frequency", "curves": [
    {"kind": "fold", "value": [0.2, 0.25], "second": [130.0, 140.0],
     "special": [{"kind": "fold_flip", "value": 0.25, "second": 140.0}]},
    {"kind": "stick_border", "value": [0.3, 0.31], "second": [130.0, 135.0]}]}
RESPONSE = {"input": "actuation_pressure", "output": "friction_torque", "kind": "periodic", "checked": [],
            "operating_point": {"mean_slip": 20.0}, "frequencies": [1.0, 10.0], "gain": [1e-3, 1e-4],
            "phase": [0.0, 3.0]}

WINDOWS = np.linspace(0.0, 1.0, 6)
ORDERS = Orders(WINDOWS, 80.0 + 100.0 * WINDOWS, np.arange(0.0, 10.1, 0.1), np.ones((6, 101)), np.ones((6, 101)),
                np.ones(1), np.ones((6, 1)), Judder(*np.ones((3, 6))), WINDOWS, (116.8, 387.3))
LINES = np.arange(0.0, 10.0)
SPECTRUM = Spectrum(100.0 * LINES, LINES, "none", 1, np.empty(0), 0.1**LINES, 0.1**LINES, None, None)

FREQUENCY, PRESSURE = "engine.frequency", "pressure.mean"
REGIMES = {"regime": ["stick", "slip", "slip", None], "runaway": [False, False, True, None],
           "transient": [False, True, False, None], "max_slip_speed": [0.0, 20.0, 900.0, None],
           "stick_fraction": [1.0, 0.0, 0.0, None], "clutch_energy": [0.0, 1.0, 2.0, None]}
SWEEP = {"over": FREQUENCY, "values": [1.0, 2.0, 3.0, 4.0], "period": [1, 0, 0, None],
         "section": [[[0.1, 0.0]], [[0.2, 0.0]], [[0.3, 0.0]], None], **REGIMES}
GRID = {"over": FREQUENCY, "second_over": PRESSURE, "values": [1.0, 2.0, 3.0, 4.0], "second_values": [1.0],
        **{name: [SWEEP[name]] for name in (*REGIMES, "period")}}
SCATTER = {"scatter": {PRESSURE: [1.0, 4.0]}, "sampled": {PRESSURE: [1.0, 2.0, 3.0, 4.0]}, "probabilities": [0.05, 0.5],
           **REGIMES, "quantiles": {name: [1.0, None] for name in REGIMES}}
BAND = {**SCATTER, "over": FREQUENCY, "values": [1.0, 2.0], "probabilities": [0.05, 0.5, 0.95],
        "quantiles": {name: [[1.0, 2.0, 3.0], [2.0, None, 4.0]] for name in REGIMES}}
FAR = {**ORBIT, "number": 1, "period": 0, "fraction": 0.0, "section_states": [[0.1, 500.0, 9.0]]}
CELLS = {**PLANE, "attractors": [ORBIT, FAR], "labels": np.array([[0, 0], [0, -1]])}
OVER = {"plane": PLANE["plane"], "over": PRESSURE, "values": [1.0, 2.0], "attractors": [[ORBIT, FAR], [ORBIT]],
        "undecided": [0.25, 0.25], "runaway": [0.0, 0.0]}
QUIET = replace(ORDERS, shaft_torque=np.where(ORDERS.order == 2.0, 1e-9, ORDERS.shaft_torque))
PARAMETER = {"key": "driveline.stiffness", "start": 3000.0, "value": 3030.0, "high": 3060.0}
CURVE = {"slip_speeds": [0.0, 1.0, 2.0], "coefficient": [0.2] * 3, "low": [0.1] * 3, "high": [0.3] * 3,
         "scene": [0.25] * 3, "visited": [True, True, False]}
FITTED = {"parameters": [PARAMETER], "chi2_per_dof": 1.0, "accepted": True, "curve": CURVE,
          "likelihood": {"key": PRESSURE, "values": [1.0, 2.0], "excess": [0.0, 9.0]}}
