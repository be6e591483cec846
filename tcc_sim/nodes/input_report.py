"""Publisher of `held`: the inputs of the driveline at every change, at least every 0.1 s, and at the end of a run."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from tcc_sim.messages import held
from tcc_sim.nodes.loop_topics import CommandedInput, Outputs
from tcc_sim.plant.driveline import Plant
from tcc_sim.topics import HELD_INPUTS, INPUTS

_NO_COMMAND = (math.nan, math.nan, math.nan, math.nan, 0, 0, 0, 0, 0)


class InputReport:
    """Report on the inputs of one driveline.

    Parameters
    ----------
    plant, outputs : of the driveline
    """

    def __init__(self, plant: Plant, outputs: Outputs) -> None:
        self._plant, self._outputs = plant, outputs
        operation = plant.scene.operation
        self._beat = max(1, math.floor(held.BEAT * operation.rate + 1e-9))
        self.begin()

    def begin(self) -> None:
        """Begin a run."""
        self._number, self._tick, self._seen = 0, -self._beat, (0, math.nan, "")

    def publish(self, commands: Sequence[CommandedInput], after: int = held.GOES_ON) -> None:
        """Publish the inputs of the tick that ended, if something has changed, they are due, or the run stops.

        Parameters
        ----------
        commands : inputs that follow commands
        after : what follows, as in `messages.held`
        """
        plant, tick = self._plant, self._plant.stepper.tick
        applied = plant.pressures[1] if plant.actuated else math.nan
        state = "".join(str(int(command.value is None)) for command in commands)
        seen = sum(command.events for command in commands), applied, state
        same = seen[0] == self._seen[0] and state == self._seen[2] and (
            applied == self._seen[1] or math.isnan(applied))
        if same and not after and tick - self._tick < self._beat:
            return
        self._seen, self._tick, self._number = seen, tick, self._number + 1
        values: list[float] = [tick, plant.stamp_ns, self._number, after]
        by_name = {command.name: command for command in commands}
        for name in HELD_INPUTS:
            values += self._report(name, by_name, applied)
        self._outputs.say("held", held.held_message(self._outputs.run, values))

    def _report(self, name: str, commands: Mapping[str, CommandedInput], applied: float) -> tuple[float, ...]:
        command = commands.get(name)
        if command is None:
            report: tuple[float, ...] = held.SCENE if name in INPUTS else held.NOBODY, *_NO_COMMAND
        else:
            report = command.report(self._outputs.zero_ns)
        return (*report[:2], applied, *report[3:]) if name == INPUTS[1] and self._plant.actuated else report
