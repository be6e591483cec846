"""Moreau and Jean's time stepping by Siconos, in a process of its own: the Python that has Siconos is often another
one.

`python siconos_relay.py` reads a job as JSON from standard input and writes section, largest slip speeds and seconds.
The friction torque of the set-valued law with mu_k = mu_s and constant pressure is a relay of the slip speed.
"""

from __future__ import annotations

import json
import math
import sys
import time
from typing import Any


def solve(job: dict[str, Any]) -> dict[str, Any]:
    """Time stepping with a fixed step and theta; the engine torque is taken at t + theta h, as the linear part is."""
    import numpy as np
    from siconos import kernel

    inertia1, inertia2, damping, stiffness = job["linear"]
    beta = 1.0 / inertia1 + 1.0 / inertia2
    cycle, count, theta = 2.0 * math.pi / job["frequency"], job["steps_per_cycle"], job["theta"]
    step = cycle / count
    system = kernel.FirstOrderLinearDS(np.array(job["initial"]), np.array(
        [[0.0, stiffness / inertia2, damping / inertia2], [0.0, 0.0, 1.0],
         [0.0, -stiffness / inertia2, -damping / inertia2]]))
    system.setbPtr(np.zeros(3))
    relay = kernel.Interaction(kernel.RelayNSL(1, -job["limit"], job["limit"]), kernel.FirstOrderLinearTIR(
        np.array([[1.0, 0.0, 0.0]]), np.array([[beta], [0.0], [-1.0 / inertia2]])))
    problem = kernel.NonSmoothDynamicalSystem(0.0, (job["cycles"] + 1) * cycle)
    problem.insertDynamicalSystem(system)
    problem.link(relay, system)
    stepping = kernel.TimeStepping(problem, kernel.TimeDiscretisation(0.0, step))
    stepping.insertIntegrator(kernel.EulerMoreauOSI(theta))
    stepping.insertNonSmoothProblem(kernel.Relay())
    forcing, state = system.b(), system.x()
    section, largest = [list(job["initial"])], []
    began = time.process_time()
    for n in range(job["cycles"]):
        most = abs(float(state[0]))
        for i in range(count):
            t = (n * count + i + theta) * step
            forcing[0] = (job["mean"] + job["amplitude"] * math.sin(job["frequency"] * t)) / inertia1
            stepping.computeOneStep()
            state = system.x()
            most = max(most, abs(float(state[0])))
            stepping.nextStep()
        section.append([float(x) for x in state])
        largest.append(most)
    return {"section": section, "largest": largest, "seconds": time.process_time() - began}


if __name__ == "__main__":
    found = solve(json.load(sys.stdin))
    # Siconos prints messages of its own to standard output.
    sys.stdout.write("\nRESULT " + json.dumps(found) + "\n")
