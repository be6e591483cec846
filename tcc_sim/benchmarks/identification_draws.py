"""Acceptance of `identify` on many draws: how often it converges, how long it takes, and whether its intervals cover.

    python -m tcc_sim.benchmarks.identification_draws FILE.jsonl [DRAWS [SCENE ...]]

Every draw has a motion of its own, solved by SciPy on the equations written out in `references`, sampled at 1 kHz for
1 s; white noise of 1 % of each channel's standard deviation; and starts 10 % off in random directions. FILE gets a line
for every draw, and draws that it holds are not made again, so that an interrupted run goes on where it was.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from tcc_sim.benchmarks.references import Law
from tcc_sim.estimation.identify import identify
from tcc_sim.estimation.measurement import Measurement
from tcc_sim.estimation.verdicts import WITHIN
from tcc_sim.model.parameters import values_of
from tcc_sim.output.tables import markdown_table
from tcc_sim.output.terminal import say
from tcc_sim.scene import load_scene

SCENES = ("fig02", "chaos")
KEYS = ("friction.static_coefficient", "friction.kinetic_coefficient", "driveline.damping", "driveline.stiffness",
        "driveline.plate_inertia")
BEGUN, RATE = 1.0, 1000.0
"""Time that the motion is left to settle, s, and samples a second."""
NOISE, OFF, DRAWS = 0.01, 0.1, 200
OUTSIDE = 4.0
"""Standard errors beyond which a value must be flagged."""


@dataclass(frozen=True)
class Draw:
    """What `identify` said of a draw, and by key by how many of its standard errors it `missed` the truth; `seconds` of
    CPU time.
    """

    scene: str
    seed: int
    accepted: bool
    chi2_per_dof: float
    starts: int
    seconds: float
    missed: Mapping[str, float]
    verdicts: Mapping[str, str]


def one_draw(scene: str, seed: int, seconds: float = 1.0) -> Draw:
    """Make one draw of so many seconds."""
    rng, loaded = np.random.default_rng(seed), load_scene(scene)
    values = dict(values_of(loaded.system))
    truth = {key: float(values[key]) for key in KEYS}  # type: ignore[arg-type]
    t = BEGUN + np.arange(round(seconds * RATE)) / RATE
    start = [rng.uniform(0.0, 20.0), loaded.system.engine.mean_torque / truth["driveline.stiffness"], 0.0]
    law = Law(loaded.system)
    run = solve_ivp(law.rates, (0.0, t[-1]), start, "LSODA", t, args=(3,), rtol=1e-10, atol=1e-11)
    noise = NOISE * run.y[[0, 2]].std(axis=1)
    slip, plate = run.y[[0, 2]] + noise[:, None] * rng.standard_normal((2, len(t)))
    free = {key: truth[key] * (1.0 + OFF * rng.choice([-1.0, 1.0])) for key in KEYS}
    began = time.process_time()
    found = identify(Measurement(t, {"slip_speed": slip, "plate_speed": plate}), free, scene=loaded,
                     noise={"slip_speed": noise[0], "plate_speed": noise[1]})
    return Draw(scene, seed, found.accepted, found.chi2_per_dof, found.starts, time.process_time() - began,
                {p.key: (p.value - truth[p.key]) / p.standard_error for p in found.parameters},
                {p.key: p.verdict for p in found.parameters})


def summary(draws: list[Draw]) -> dict[str, str]:
    """What a row of the table says of some draws; the intervals are those of the fits that were accepted."""
    fits, seconds = [d for d in draws if d.accepted], [d.seconds for d in draws]
    missed = np.array([[d.missed[key] for key in KEYS] for d in fits])
    flagged = np.array([[d.verdicts[key] != "identified" for key in KEYS] for d in fits])
    covered = np.abs(missed) <= WITHIN
    return {"draws": str(len(draws)), "converged": f"{100.0 * len(fits) / len(draws):.1f} %",
            "restarted": str(sum(d.starts > 1 for d in draws)), "CPU s, median": f"{np.median(seconds):.1f}",
            "largest": f"{max(seconds):.1f}", "coverage": f"{covered.mean():.3f}",
            "by key": ", ".join(f"{share:.3f}" for share in covered.mean(axis=0)),
            "largest miss, standard errors": f"{np.abs(missed).max():.2f}",
            "beyond four, not flagged": str(int(np.sum((np.abs(missed) > OUTSIDE) & ~flagged)))}


def main(words: list[str]) -> None:
    """Make the draws that a file does not hold, and print the table of all that it holds then."""
    path, count, scenes = Path(words[0]), int(words[1]) if len(words) > 1 else DRAWS, words[2:] or SCENES
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    done = {(d.scene, d.seed): d for d in (Draw(**json.loads(line)) for line in lines)}
    with path.open("a", encoding="utf-8") as file:
        for seed in range(count):
            for scene in scenes:
                if (scene, seed) not in done:
                    done[scene, seed] = one_draw(scene, seed)
                    file.write(json.dumps(vars(done[scene, seed])) + "\n")
                    file.flush()
    rows = {scene: summary([d for (of, _), d in done.items() if of == scene]) for scene in scenes}
    head = list(next(iter(rows.values())))
    say("\n".join(markdown_table(["scene", *head], [[scene, *row.values()] for scene, row in rows.items()])))


if __name__ == "__main__":
    main(sys.argv[1:])
