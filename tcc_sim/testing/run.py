"""What a driveline under test did, and what fails a test. Free of ROS."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from tcc_sim.analysis.control import Tracking, tracking
from tcc_sim.analysis.cycle_means import MeansOfCycles
from tcc_sim.analysis.cycles import default_discard
from tcc_sim.analysis.engine_clock import Uniform, clock_of_scene
from tcc_sim.errors import InputError, TccError
from tcc_sim.plant.closed_loop import ControlledRun


class ControllerFailed(TccError, AssertionError):
    """A node under test died, hangs or does not answer; the sentence says which, and when."""


@dataclass(frozen=True, repr=False)
class LockstepRun(ControlledRun):
    """What a driveline did under the commands of the nodes under test.

    missed : ticks in which an input had no new command: it was dropped, late, or refused
    target : slip speed that was asked for, rad/s, and the sample from which on; None where nobody said it
    """

    missed: int = 0
    target: tuple[float, int] | None = None

    @cached_property
    def tracking(self) -> Tracking:
        """How well the slip speed's mean over each engine cycle held the target since it was last changed.

        Raises
        ------
        InputError
            Nobody said a target.
        """
        if self.target is None:
            raise InputError("no target: no node published target_slip_speed, and run(target=...) was not given")
        target, since = self.target
        means = MeansOfCycles(Uniform(self.cycle) if self.system is None else clock_of_scene(self.system))
        means.feed(self.t[since:], self.slip_speed[since:])
        found = means.means()
        return tracking(target, found, self.cycle, default_discard(len(found)))
