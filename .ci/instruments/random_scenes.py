"""Solve random scenes beside an independent integrator: python .ci/instruments/random_scenes.py [COUNT [SEED]].

A scene is drawn by its seed: smoothed or set-valued law, falling or rising friction or a table with noise, profiles,
tables of inputs with each hold, an actuator, a moving far end, slow slip, the fluid path of the converter. The other
solution is SciPy's LSODA on the equations of study/benchmarks/references.py under the excitation below; the set-valued
law is compared with the smoothed one of a large sigma. Nothing of the solvers is used, and of the model the numbers of
the scene and the fit of a friction table, which is compared with the table.
"""

from __future__ import annotations

import csv
import itertools
import math
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import odeint, solve_ivp

from tcc_sim.model.parameters import System, replace
from tcc_sim.replay.given_inputs import driven_by
from tcc_sim.scene import Scene, load_scene
from tcc_sim.study.benchmarks.references import Law
from tcc_sim.sweeps.simulation import simulate

HOLDS = ("previous", "linear", "smooth", "next")
SECONDS, SAMPLES = 0.25, 64
"""Length of a run, s, and samples per period of excitation."""
SHARP = 1e5
"""sigma, s/rad, that stands for the set-valued law."""
WITHIN = {"smoothed": 1e-4, "set_valued": 5e-3, "fixed_step": 2e-2, "actuator": 3e-3}
"""Largest difference of the slip speed, relative to its largest value, by law, solver or part: the response of an
actuator is joined by straight lines.
"""
SLIPS = [0.0, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 40.0, 80.0, 160.0]


@dataclass
class Drawn:
    """A random scene: values of its keys, rows of a table of inputs with their hold, and words for a line."""

    values: dict[str, Any]
    rows: dict[str, list[float]] = field(default_factory=dict)
    hold: str = "previous"
    words: list[str] = field(default_factory=list)


def draw(seed: int) -> Drawn:
    """Return the scene of a seed."""
    g = np.random.default_rng(seed)
    law, omega = ("smoothed", "set_valued")[seed % 2], float(g.uniform(80.0, 300.0))
    mean, mu = float(g.uniform(150.0, 300.0)), float(g.uniform(0.1, 0.3))
    slow = g.random() < 0.25
    ease = float(g.uniform(0.9, 1.1) if slow else g.uniform(0.7, 1.8))
    values: dict[str, Any] = {
        "friction.law": law, "friction.smoothing": float(10.0 ** g.uniform(1.0, 3.0)),
        "friction.kinetic_coefficient": mu, "friction.static_coefficient": mu * float(g.uniform(1.0, 1.3)),
        "friction.decay": float(g.uniform(0.05, 3.0)), "engine.mean_torque": mean, "engine.frequency": omega,
        "engine.torque_amplitude": float(g.uniform(5.0, 25.0) if slow else g.uniform(20.0, 250.0)),
        "pressure.mean": ease * mean / (0.008 * mu), "pressure.amplitude": 0.0,
        "initial.slip_speed": float(g.uniform(0.1, 2.0) if slow else g.uniform(0.0, 80.0)),
        "initial.plate_angle": mean / 3000.0}
    fluid = g.random() < 0.25
    values["converter.coupling"] = float(10.0 ** g.uniform(-2.0, 1.0)) if fluid else 0.0
    words = [law] + ["slow slip"] * slow + ["coupling"] * fluid
    kind = g.choice(["falls", "rises", "table", "no slope"])
    if kind == "rises":
        values["friction.static_coefficient"] = mu * float(g.uniform(0.6, 0.95))
    if kind == "no slope":
        values["friction.static_coefficient"] = mu
    if kind == "table":
        v = np.array(SLIPS)
        shape = 1.0 + float(g.uniform(-0.3, 0.3)) * np.exp(-v / float(g.uniform(2.0, 30.0)))
        noise = float(g.choice([0.0, 0.004, 0.01]))
        values |= {"friction.slip_speeds": SLIPS,
                   "friction.coefficients": (mu * shape * (1.0 + noise * g.normal(size=len(v)))).tolist()}
        kind = f"table with {noise:.1%} of noise"
    drawn = Drawn(values, words=[*words, str(kind)])
    excite(drawn, g, law)
    return drawn


def excite(drawn: Drawn, g: np.random.Generator, law: str) -> None:
    """Add a pulsation, profiles, a table of inputs or a moving far end."""
    values, mean, pressure = drawn.values, drawn.values["engine.mean_torque"], drawn.values["pressure.mean"]
    what = str(g.choice(["sines", "pulsation", "profiles", "inputs", "actuator", "far end"]))
    if what in ("profiles", "inputs", "actuator", "far end") and law == "set_valued":   # The package refuses these.
        what = "pulsation"
    if what == "pulsation":
        values |= {"pressure.amplitude": float(g.uniform(0.05, 1.2)) * pressure, "pressure.phase": float(g.uniform(
            0.0, 6.0)), "pressure.frequency_ratio": float(g.choice([0.5, 1.0, 2.0]))}
    if what == "profiles":
        times = [0.0, float(g.uniform(0.05, 0.1)), float(g.uniform(0.12, 0.3))]
        for key, size, low in (("engine.frequency", values["engine.frequency"], 0.8), ("pressure.mean", pressure, 0.8),
                               ("engine.mean_torque", mean, 0.6)):
            values |= {f"{key}_times": times, f"{key}_values": (size * g.uniform(low, 1.2, 3)).tolist()}
    if what in ("inputs", "actuator", "far end"):
        step = float(g.choice([2e-3, 5e-3]))
        t = step * np.arange(round(SECONDS / step) + 2)
        drawn.hold = str(g.choice(HOLDS))
        drawn.rows = {"t": t.tolist()}
        if what == "far end":
            drawn.rows["output_speed"] = (g.uniform(0.5, 3.0) * np.sin(g.uniform(5.0, 30.0) * t)).tolist()
        else:
            wave = np.sin(values["engine.frequency"] * t) if step < 4e-3 else np.sin(60.0 * t)
            drawn.rows |= {"engine_torque": (mean + values["engine.torque_amplitude"] * wave).tolist(),
                           "actuation_pressure": (pressure * g.uniform(0.0, 1.5, len(t)).clip(0.3)).tolist()}
        if what == "actuator":
            values |= {"pressure.source": "topic", "pressure.time_constant": float(g.choice([0.005, 0.03])),
                       "pressure.delay": float(g.choice([0.0, 0.01])),
                       "pressure.rate_limit": float(g.choice([0.0, 2e7]))}
    drawn.words += [what] + [f"hold {drawn.hold}"] * bool(drawn.rows)


class Driven(Law):
    """Equations under a torque, N m, a pressure, Pa, and speed and angle of the far end, by time."""

    def __init__(self, system: System, engine: Callable[[float], float], pressure: Callable[[float], float],
                 far: Callable[[float], tuple[float, float]] | None) -> None:
        super().__init__(system)
        self.engine, self.far = engine, far  # type: ignore[method-assign]
        self.load = lambda t: system.torque_per_pressure * pressure(t)  # type: ignore[method-assign]

    def rates(self, t: float, y: Any, mode: int) -> list[float]:
        """Return the derivatives, with the torque of the far end on the plate."""
        out, d = super().rates(t, y, mode), self.system.driveline
        if self.far is not None:
            speed, angle = self.far(t)
            push = (d.damping * speed + d.stiffness * angle) / d.plate_inertia
            out[0], out[2] = out[0] - push, out[2] + push
        return out


class Excited:
    """The excitation of a drawn scene, written for itself, and the independent equations under it."""

    def __init__(self, drawn: Drawn, scene: Scene) -> None:
        v, rows = drawn.values, drawn.rows
        self.values, self.t = v, np.array(rows.get("t", [0.0, 1e9]))
        self.lines = {name: self.held(np.array(rows[name]), drawn.hold) for name in rows if name != "t"}
        self.times = {float(x) for key in v if key.endswith("_times") for x in v[key]} | set(rows.get("t", []))
        late = v.get("pressure.delay", 0.0)
        self.times |= {x + late for x in list(self.times)}
        self.actuated = "pressure.time_constant" in v
        self.plates: Callable[[float], np.ndarray] | None = None
        speed = self.lines.get("output_speed")
        if speed is not None:
            x, y, rate = speed
            steps = np.diff(x)
            self.turned = np.append(0.0, np.cumsum(y[:-1] * steps + 0.5 * rate[:-1] * steps**2))
        sigma = v["friction.smoothing"] if v["friction.law"] == "smoothed" else SHARP
        system = replace(scene.system, {"friction.law": "smoothed", "friction.smoothing": sigma})
        self.law = Driven(system, self.engine, self.pressure, None if speed is None else self.far)

    def held(self, values: np.ndarray, hold: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times, values and rates of lines between rows."""
        t = self.t
        if hold == "previous":
            return t, values, 0.0 * t
        if hold == "next":
            return t[:-1], values[1:], 0.0 * t[:-1]
        corners = values.copy()
        if hold == "smooth":   # A sine keeps its amplitude: its corners are higher by the twelfth of the curvature.
            for k in range(1, len(t) - 1):
                bend = (values[k + 1] - values[k]) / (t[k + 1] - t[k]) - (values[k] - values[k - 1]) / (t[k] - t[k - 1])
                corners[k] -= (t[k + 1] - t[k]) * (t[k] - t[k - 1]) / 12.0 * 2.0 * bend / (t[k + 1] - t[k - 1])
        return t, corners, np.append(np.diff(corners) / np.diff(t), 0.0)

    def at(self, name: str, t: float) -> float:
        """Value of an input at a time; the first row holds before it."""
        x, y, rate = self.lines[name]
        k = max(int(np.searchsorted(x, t, side="right")) - 1, 0)
        if name == "actuation_pressure":   # No corner is below 0.
            y = np.maximum(y, 0.0)
            rate = np.append(np.diff(y) / np.diff(x), 0.0) if rate.any() else rate
        return float(y[k] + rate[k] * max(t - x[k], 0.0))

    def profile(self, key: str, t: float) -> float:
        """Value of a key at a time."""
        if f"{key}_times" not in self.values:
            return float(self.values[key])
        return float(np.interp(t, self.values[f"{key}_times"], self.values[f"{key}_values"]))

    def phase(self, t: float) -> float:
        """Integral of omega."""
        if "engine.frequency_times" not in self.values:
            return float(self.values["engine.frequency"]) * t
        x, y = self.values["engine.frequency_times"], self.values["engine.frequency_values"]
        marks = [0.0, *(a for a in x if 0.0 < a < t), t]
        return sum(0.5 * (b - a) * float(np.interp(a, x, y) + np.interp(b, x, y)) for a, b in itertools.pairwise(marks))

    def engine(self, t: float) -> float:
        """Engine torque, N m."""
        if "engine_torque" in self.lines:
            return self.at("engine_torque", t)
        sine = self.values["engine.torque_amplitude"] * math.sin(self.phase(t))
        return self.profile("engine.mean_torque", t) + float(sine)

    def pressure(self, t: float) -> float:
        """Pressure at the plates, Pa."""
        if self.plates is not None:
            return float(self.plates(t)[0]) * 1e5
        if "actuation_pressure" in self.lines:
            return self.at("actuation_pressure", t)
        v = self.values
        sine = math.sin(v.get("pressure.frequency_ratio", 1.0) * self.phase(t) + v.get("pressure.phase", 0.0))
        return self.profile("pressure.mean", t) + float(v["pressure.amplitude"] * sine)

    def actuator(self, t: float, y: np.ndarray) -> np.ndarray:
        """Rate of the pressure at the plates, both in bar."""
        v, late = self.values, t - self.values["pressure.delay"]
        command = (self.at("actuation_pressure", late) if late >= 0.0 else v["pressure.mean"]) / 1e5
        limit = (v["pressure.rate_limit"] or math.inf) / 1e5
        return np.clip((command - y) / v["pressure.time_constant"], -limit, limit)

    def far(self, t: float) -> tuple[float, float]:
        """Speed and angle of the driveline's far end."""
        x, w, rate = self.lines["output_speed"]
        k = max(int(np.searchsorted(x, t, side="right")) - 1, 0)
        past = t - x[k]
        return float(w[k] + rate[k] * past), float(self.turned[k] + w[k] * past + 0.5 * rate[k] * past**2)

    def slip(self, t: np.ndarray) -> np.ndarray:
        """Slip speed at rising times, begun again at every corner of the excitation."""
        state = np.array([self.values["initial.slip_speed"], self.values["initial.plate_angle"], 0.0])
        bar, out = np.array([self.values["pressure.mean"] / 1e5]), np.empty(len(t))
        marks = [0.0, *sorted({round(x, 9) for x in self.times if 1e-8 < x < t[-1] - 1e-8}), float(t[-1])]
        for a, b in itertools.pairwise(marks):
            out[np.abs(t - a) <= 1e-9] = state[0]
            inside = np.flatnonzero((t > a + 1e-9) & (t < b - 1e-9))

            def within(at: float, a: float = a, b: float = b) -> float:
                return min(max(at, a), b - 1e-12)  # The next piece does not act yet.

            if self.actuated:
                run = solve_ivp(lambda at, y, of=within: self.actuator(of(at), y), (a, b), bar, dense_output=True,
                                rtol=1e-9, atol=1e-9, max_step=(b - a) / 8)
                self.plates, bar = run.sol, run.y[:, -1]
            result = odeint(lambda at, y, of=within: self.law.rates(of(at), y, 3)[:3], state,
                            np.concatenate([[a], t[inside], [b]]), tfirst=True, rtol=1e-9, mxstep=200_000,
                            atol=[1e-9 / max(self.law.system.friction.smoothing / 50.0, 1.0), 1e-11, 1e-9])
            out[inside], state = result[1:-1, 0], result[-1]
        out[np.abs(t - marks[-1]) <= 1e-9] = state[0]
        return out


def compare(seed: int, folder: Path, solved: Callable[..., Any]) -> tuple[float, float, list[str]]:
    """Return the difference of a scene's slip speed, the largest allowed one, and the scene's words."""
    drawn = draw(seed)
    base = "controlled" if "pressure.source" in drawn.values else "fig02"
    scene = load_scene(base).with_values({**({"engine.source": "harmonic"} if base == "controlled" else {}),
                                          **drawn.values})
    separate, given = Excited(drawn, scene), scene
    if drawn.rows:
        path = folder / f"{seed}.csv"
        with path.open("w", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow(drawn.rows)
            writer.writerows(zip(*(map(repr, column) for column in drawn.rows.values())))
        given = driven_by(scene, path, drawn.hold)
    run = solved(given, duration=SECONDS, samples_per_cycle=SAMPLES, rtol=1e-9 if "output_speed" not in drawn.rows
                 else None).raise_for_status().trajectory
    other = separate.slip(run.t)
    size = max(float(np.abs(other).max()), 1e-3)
    which = ("fixed_step" if run.solver == "fixed_step" else "actuator" if separate.actuated
             else drawn.values["friction.law"])
    allowed = WITHIN[which]
    error = float(np.abs(run.slip_speed - other).max()) / size
    if scene.system.friction.curve is not None:
        error = max(error, beyond_table(scene) and math.inf)
    return error, allowed, [*drawn.words, run.solver]


def beyond_table(scene: Scene) -> bool:
    """Return whether the fit of a table is further off than it says, or turns where the points do not."""
    friction = scene.system.friction
    curve, mu = friction.curve, np.array(friction.coefficients)
    assert curve is not None
    off = np.abs(curve.at(np.array(friction.slip_speeds)) - mu).max() > (curve.error + 1e-9) * mu.max()
    slope, rises = curve.slope(np.geomspace(1e-3, 1e3, 3000)), np.diff(mu) > 0.0
    return bool(off or (rises.all() and slope.min() < -1e-9) or (not rises.any() and slope.max() > 1e-9))


def main(count: int, first: int, solved: Callable[..., Any] = simulate) -> int:
    """Compare scenes, solved as `simulate` does; return the number of those that differ."""
    began, wrong = time.perf_counter(), 0
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, first + count):
            error, allowed, words = compare(seed, Path(folder), solved)
            wrong += error > allowed
            if error > allowed:
                sys.stdout.write(f"seed {seed}: {error:.2g} of the largest slip speed, allowed {allowed:g}: "
                                 f"{', '.join(words)}\n")
    sys.stdout.write(f"{count} scenes in {time.perf_counter() - began:.0f} s, {wrong} of them differ\n")
    return wrong


if __name__ == "__main__":
    sys.exit(main(*(int(word) for word in (sys.argv[1:] + ["200", "0"][len(sys.argv) - 1:]))) > 0)
