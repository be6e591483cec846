"""One motion solved and judged: its summary, and the extras asked for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tcc_sim.analysis.cycles import cycles_of, default_discard
from tcc_sim.analysis.damping import Damping, damping_as_json, damping_of_cycles
from tcc_sim.analysis.summary import Summary, summarise
from tcc_sim.model.parameters import System
from tcc_sim.scene import Scene, load_scene
from tcc_sim.solvers import solve
from tcc_sim.studies.lyapunov import Lyapunov, largest_lyapunov_exponent
from tcc_sim.trajectory import State, Trajectory


@dataclass(frozen=True, repr=False)
class Simulation:
    """A motion solved and judged.

    trajectory : what the solver gave
    summary : maxima, section, period, regime
    damping, lyapunov : where asked for
    """

    trajectory: Trajectory
    summary: Summary
    damping: Damping | None = None
    lyapunov: Lyapunov | None = None

    def __repr__(self) -> str:
        found = self.summary
        period = f"period {found.period}" if found.period else "no period"
        return (f"<Simulation by {found.solver}: {found.cycles} cycles, {period}, {found.regime}; "
                f"largest |slip speed| {found.max_slip_speed:.5g} rad/s>")

    def as_json(self) -> dict[str, Any]:
        """The keys of `simulate --json`, with those of the extras that were asked for."""
        out = self.summary.as_json()
        if self.damping is not None:
            out.update(damping_as_json(self.damping))
        if self.lyapunov is not None:
            out["lyapunov"] = self.lyapunov.as_json()
        return out


def simulate(scene: Scene | System | str | Path, *, cycles: int = 150, discard: int | None = None, damping: bool = False,
             lyapunov: bool = False, solver: str = "auto", rtol: float | None = None,
             step: float | None = None) -> Simulation:
    """Solve a motion and work out its summary and whatever else is asked for.

    Parameters
    ----------
    scene : a scene, its name or file, or a system
    cycles : engine cycles solved
    discard : of them dropped; None drops 50, or half of them where there are fewer than 100
    damping : work out the equivalent damping (21)
    lyapunov : work out the largest Lyapunov exponent of the smoothed law
    solver, rtol, step : as `solve` takes them

    Raises
    ------
    InputError
        An unknown scene or setting, or a value out of its range.
    NumericalFailure
        The solver stopped before the end.

    Examples
    --------
    >>> import tcc_sim
    >>> found = tcc_sim.simulate("slip", cycles=60)
    >>> found.summary.period, found.summary.regime
    (1, 'slip')
    """
    system = scene if isinstance(scene, System) else (scene if isinstance(scene, Scene) else load_scene(scene)).system
    run = solve(system, cycles=cycles, solver=solver, rtol=rtol, step=step).raise_for_status()
    kept = cycles_of(run)
    dropped = default_discard(len(kept)) if discard is None else discard
    summary = summarise(run, dropped)
    averages = damping_of_cycles(system, kept[dropped:], dropped, summary.period, solver=solver, rtol=rtol,
                                 step=step) if damping else None
    growth = largest_lyapunov_exponent(system, State(*kept.section[-1].tolist()), start_cycle=len(kept),
                                       period=summary.period) if lyapunov else None
    return Simulation(run, summary, averages, growth)
