"""A controller in an FMU for co-simulation as a law of `closed_loop`, through FMPy."""

from __future__ import annotations

import shutil
import weakref
from collections.abc import Mapping
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

from tcc_sim.errors import InputError, TccError, one_line, require
from tcc_sim.plant.driveline import Reading
from tcc_sim.topics import FAR_END, INPUTS

ANSWERS = (*INPUTS, FAR_END)
"""Names of an FMU's outputs that are commands."""


class FmuController:
    """Law whose answer is what an FMU computes from a state, see `fmu_controller`."""

    def __init__(self, path: str | Path, names: Mapping[str, str] | None = None,
                 parameters: Mapping[str, float] | None = None) -> None:
        require("fmpy", "a controller in an FMU")
        import fmpy
        from fmpy import fmi2, fmi3
        from fmpy.fmi1 import FMICallException

        self._path, self._failure = Path(path), FMICallException
        self._now: int | None = None
        folder = mkdtemp()
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        try:
            described = fmpy.read_model_description(str(path))
            unpacked = fmpy.extract(str(path), unzipdir=folder)
        except Exception as error:  # FMPy raises various exceptions on what is no FMU.
            raise InputError(f"{path} cannot be read as an FMU: {one_line(str(error))}") from None
        if described.coSimulation is None or described.fmiVersion[0] not in "23":
            raise InputError(f"{path} is of FMI {described.fmiVersion}; a controller must be an FMU 2 or 3 for "
                             "co-simulation")
        rows = {row.name: row for row in described.modelVariables}
        of = {name: (names or {}).get(name, name) for name in (*Reading._fields, *ANSWERS)}
        self._inputs = {name: rows[of[name]].valueReference for name in Reading._fields
                        if of[name] in rows and rows[of[name]].causality == "input"}
        self._outputs = {name: rows[of[name]].valueReference for name in ANSWERS
                         if of[name] in rows and rows[of[name]].causality == "output"}
        self._parameters = {rows[name].valueReference: float(value) for name, value in (parameters or {}).items()
                            if name in rows and rows[name].causality == "parameter"}
        if unknown := [*(f"{name}={of.get(name, '')}" for name in names or {}
                         if name not in {**self._inputs, **self._outputs}),
                       *(name for name in parameters or {} if name not in rows or rows[name].causality != "parameter")]:
            raise InputError(f"{path} has no variable for {', '.join(unknown)}; its variables are {', '.join(rows)}")
        if not self._outputs:
            raise InputError(f"{path} has no output {' or '.join(ANSWERS)}; name one, for instance "
                             f'names={{"{INPUTS[1]}": "{next(iter(rows), "y")}"}}')
        self._two = described.fmiVersion.startswith("2")
        kind = fmi2.FMU2Slave if self._two else fmi3.FMU3Slave
        token = described.guid if self._two else described.instantiationToken
        try:
            self._slave: Any = kind(guid=token, unzipDirectory=unpacked, instanceName="controller",
                                    modelIdentifier=described.coSimulation.modelIdentifier)
            self._slave.instantiate()
        except Exception as error:  # A missing binary, a library that does not load, or a refusal.
            raise InputError(f"{path} does not run on this machine: {one_line(str(error))}") from None
        weakref.finalize(self, self._slave.freeInstance)

    def __call__(self, state: Reading) -> tuple[float | None, float | None, float | None]:
        """Return engine torque (N m), pressure (Pa) and speed of the far end (rad/s) for a state; None without output.

        Raises TccError: the FMU refuses a call.
        """
        put, get = ((self._slave.setReal, self._slave.getReal) if self._two else
                    (self._slave.setFloat64, self._slave.getFloat64))
        values = [float(getattr(state, name)) for name in self._inputs]
        now = state.stamp_ns
        try:
            if self._now is None or now <= self._now:
                if self._now is not None:
                    self._slave.reset()
                start = {"startTime": now * 1e-9}
                if self._two:
                    self._slave.setupExperiment(**start)
                put([*self._parameters, *self._inputs.values()], [*self._parameters.values(), *values])
                self._slave.enterInitializationMode(**({} if self._two else start))
                self._slave.exitInitializationMode()
            else:
                put(list(self._inputs.values()), values)
                self._slave.doStep(currentCommunicationPoint=self._now * 1e-9,
                                   communicationStepSize=(now - self._now) * 1e-9)
            answers = dict(zip(self._outputs, map(float, get(list(self._outputs.values())))))
        except self._failure as error:
            raise TccError(f"{self._path} failed at {now * 1e-9:.9g} s: {one_line(str(error))}") from None
        self._now = now
        torque, pressure, speed = map(answers.get, ANSWERS)
        return torque, pressure, speed


def fmu_controller(path: str | Path, names: Mapping[str, str] | None = None,
                   parameters: Mapping[str, float] | None = None) -> FmuController:
    """Return the controller in an FMU (FMI 2.0 or 3.0, co-simulation) as a law of `closed_loop`.

    Its inputs are taken by the names of a Reading (`slip_speed`, `engine_torque`, ...), its outputs by
    `actuation_pressure` (Pa), `engine_torque` (N m) and `output_speed` (rad/s). It answers the first state after its
    initialisation, and each later one after a step from the time of the state before to that of this one, with this
    one's values. A state that is not later than the one before begins anew.

    Parameters
    ----------
    path : the FMU, with a binary for this machine
    names : variables of the FMU by the names above, where they differ: ``{"actuation_pressure": "y"}``
    parameters : values of the FMU's parameters by their names

    Raises
    ------
    InputError
        FMPy is not installed, the file is no such FMU, does not run on this machine, has none of the outputs, or lacks
        a variable in `names` or `parameters`.

    Examples
    --------
    >>> import tcc_sim
    >>> law = tcc_sim.fmu_controller("pi.fmu", names={"actuation_pressure": "y"})  # doctest: +SKIP
    >>> run = tcc_sim.closed_loop("controlled", law, seconds=3.0)                  # doctest: +SKIP
    """
    return FmuController(path, names, parameters)
