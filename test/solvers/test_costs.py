"""Steps that motions take at a tolerance: more of them cost time, and fewer of them show a control of errors that lets
through what it refused. The figures are counts of this package; other tests judge the numbers that the steps give.
"""

from __future__ import annotations

import numpy as np
import pytest

from tcc_sim.model.parameters import System, replace
from tcc_sim.scene import load_scene
from tcc_sim.solvers import solve
from tcc_sim.solvers.stroboscopic import buffers_of_thread, stroboscopic_map
from tcc_sim.trajectory import Status

FIG02 = load_scene("fig02").system
PLAIN = {"pressure.mean": 225e3, "pressure.amplitude": 0.0, "friction.kinetic_coefficient": 0.3}
OVERDAMPED = {"friction.law": "set_valued", "driveline.damping": 40.0, "driveline.plate_inertia": 1e-3,
              "engine.mean_torque": 20.0, "engine.torque_amplitude": 1500.0, "initial.slip_speed": 5.0}
SCENES = {
    "fig02": FIG02, "set_valued": replace(FIG02, {"friction.law": "set_valued"}),
    "plain": replace(System(), PLAIN), "sharp": replace(System(), {**PLAIN, "friction.smoothing": 1e6}),
    "slow": replace(System(), {"engine.frequency": 1e-2, "initial.slip_speed": 0.0}),
    "stuck": load_scene("stick").system, "slipping": load_scene("slip").system,
    "several exponentials": load_scene("aged_fluid").system, "run-up": load_scene("runup").system,
    "tip-in": load_scene("tip_in").system,
    "no decay": replace(System(), {"friction.decay": 0.0}),
    "fluid": replace(FIG02, {"converter.coupling": 300.0}),
    "light plate": replace(System(), {
        "friction.kinetic_coefficient": 0.15, "driveline.damping": 1e3, "driveline.stiffness": 1.0,
        "driveline.plate_inertia": 1e-6, "engine.torque_amplitude": 0.0, "pressure.mean": 52083.3,
        "pressure.amplitude": 1e4, "initial.slip_speed": 1e4}),
    "falling": replace(System(), {
        "friction.kinetic_coefficient": 0.12, "friction.smoothing": 132.0, "pressure.mean": 1e3,
        "pressure.amplitude": 138.0, "engine.frequency": 15.7, "driveline.plate_inertia": 0.0135,
        "driveline.flywheel_inertia": 7.86, "initial.slip_speed": 0.0}),
    "overdamped": replace(System(), OVERDAMPED),
    "overdamped, stuck": replace(System(), {**OVERDAMPED, "driveline.damping": 1e4, "pressure.mean": 400e3,
                                            "pressure.amplitude": 1.0, "initial.slip_speed": 0.0,
                                            "engine.torque_amplitude": 250.0, "engine.mean_torque": 300.0,
                                            "driveline.plate_inertia": 0.0016}),
}
COUNTS = {
    "fig02": [(82, 2, 24), (137, 3, 48), (123, 2, 49)],
    "set_valued": [(34, 0, 0), (59, 0, 0), (51, 0, 0)],
    "plain": [(53, 2, 29), (85, 3, 60), (69, 3, 57)],
    "sharp": [(60, 2, 63), (91, 2, 108), (78, 4, 94)],
    "slow": [(102, 15, 221), (262, 22, 623), (148, 13, 280)],
    "stuck": [(21, 0, 28), (42, 7, 100), (36, 4, 87)],
    "slipping": [(29, 0, 0), (32, 0, 0), (65, 1, 45)],
    "several exponentials": [(272, 13, 107), (652, 28, 725), (132, 8, 167)],
    "run-up": [(149, 5, 55), (254, 15, 270)],
    "tip-in": [(24, 0, 23), (38, 2, 70)],
    "no decay": [(85, 4, 50), (136, 8, 160), (99, 6, 200)],
    "fluid": [(290, 20, 482), (508, 34, 774), (85, 13, 377)],
    "light plate": [(45, 0, 25), (68, 0, 46), (59, 1, 124)],
    "falling": [(80, 1, 18), (144, 1, 32), (459, 3, 25)],
    "overdamped": [(228, 0, 0), (355, 0, 0), (1060, 0, 0)],
    "overdamped, stuck": [(28, 0, 0), (27, 0, 0), (1269, 0, 0)],
}
"""Steps, refused steps and iterations of six engine cycles at tolerances of 1e-4 and 1e-8, and of two cycles with
derivatives at 1e-8. At 1e-12 rounding decides a tenth of them.
"""
START = np.array([5.0, 0.1, -5.0])


def near(counts: list[tuple[int, ...]], expected: list[tuple[int, ...]]) -> bool:
    """Whether counts are those expected, to one in twenty and two: rounding differs between processors."""
    return len(counts) == len(expected) and all(
        abs(a - b) <= 2.0 + 0.05 * b for one, other in zip(counts, expected) for a, b in zip(one, other))


@pytest.mark.parametrize("name", COUNTS)
def test_a_motion_takes_so_many_steps_and_iterations(name: str) -> None:
    system, expected = SCENES[name], COUNTS[name]
    runs = [solve(system, cycles=6, rtol=rtol) for rtol in (1e-4, 1e-8)]
    assert {run.status for run in runs} == {Status.DONE}
    counts = [(each.steps, each.rejected, each.iterations) for each in (run.statistics for run in runs)]
    if len(expected) > 2:
        stroboscopic_map(system, START, 2, rtol=1e-8)
        counters = buffers_of_thread.buffers.memory.counters
        before = counters.item()
        stroboscopic_map(system, START, 2, rtol=1e-8)
        counts.append(tuple(np.subtract(counters.item(), before)[:3].tolist()))
    assert near(counts, expected), counts
