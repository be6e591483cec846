"""FMUs of the tests: written once, and driven through FMPy by the names of their variables."""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("fmpy", reason="FMPy is not installed")

import fmpy
from fmpy import fmi2, fmi3

from tcc_sim.fmi.export import compiler, export
from tcc_sim.scene import Scene, load_scene

needs_compiler = pytest.mark.skipif(compiler() is None, reason="there is no C compiler")
FOLDER = tempfile.TemporaryDirectory()
FAST = ("-O0",)
"""The compiler is three times as fast; the exported binaries of `test_importers` and `test_page` are optimised."""
DISCARD = 2
"""Status of both versions of FMI."""


def written(scene: Scene | str, version: int, step: float | None = None, options: tuple[str, ...] = FAST) -> Path:
    """The unpacked FMU of a scene, compiled once, beside model.fmu."""
    scene = load_scene(scene) if isinstance(scene, str) else scene
    return _written(scene.with_values({"pacing": "lockstep"}).text(), version, step, options)


@cache
def _written(text: str, version: int, step: float | None, options: tuple[str, ...]) -> Path:
    folder = Path(tempfile.mkdtemp(dir=FOLDER.name))
    (folder / "scene.yaml").write_text(text)
    export(load_scene(str(folder / "scene.yaml")), folder / "model.fmu", version, step, options=options)
    return Path(fmpy.extract(str(folder / "model.fmu"), unzipdir=str(folder / "unpacked")))


class Driven:
    """An instance of an unpacked FMU.

    Attributes
    ----------
    said : status and sentence of everything that it logged
    """

    def __init__(self, unpacked: Path, token: str | None = None) -> None:
        described = fmpy.read_model_description(str(unpacked))
        self.version = int(described.fmiVersion[0])
        self.references = {row.name: row.valueReference for row in described.modelVariables}
        self.parameters = [row for row in described.modelVariables if row.causality == "parameter"]
        self.step = float(described.defaultExperiment.stepSize)
        self.time, self.said = 0.0, list[tuple[int, str]]()
        token_given = token or (described.guid if self.version == 2 else described.instantiationToken)
        words = {"unzipDirectory": str(unpacked), "modelIdentifier": described.coSimulation.modelIdentifier,
                 "instanceName": "plant", "guid": token_given}
        self.slave: Any = fmi2.FMU2Slave(**words) if self.version == 2 else fmi3.FMU3Slave(**words)
        if self.version == 2:
            self._callbacks = fmi2.fmi2CallbackFunctions()
            self._callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(
                lambda env, name, status, category, text: self.said.append((status, text.decode())))
            self.slave.instantiate(callbacks=self._callbacks)
        else:
            self.slave.instantiate(logMessage=lambda env, status, category, text: self.said.append(
                (status, text.decode())))

    def begin(self, start: float = 0.0) -> Driven:
        """Through initialisation."""
        if self.version == 2:
            self.slave.setupExperiment(startTime=start)
            self.slave.enterInitializationMode()
        else:
            self.slave.enterInitializationMode(startTime=start)
        self.slave.exitInitializationMode()
        self.time = start
        return self

    def put(self, values: dict[str, float]) -> None:
        """Set variables in one call."""
        references = [self.references[name] for name in values]
        (self.slave.setReal if self.version == 2 else self.slave.setFloat64)(references, list(values.values()))

    def get(self, *names: str) -> list[float]:
        """Values of variables."""
        references = [self.references[name] for name in names]
        return list((self.slave.getReal if self.version == 2 else self.slave.getFloat64)(references))

    @property
    def stick_slip_state(self) -> int:
        """The one whole number."""
        get = self.slave.getInteger if self.version == 2 else self.slave.getInt32
        return int(get([self.references["stick_slip_state"]])[0])

    def go(self, ticks: int = 1) -> None:
        """One communication step."""
        self.slave.doStep(currentCommunicationPoint=self.time, communicationStepSize=ticks * self.step)
        self.time += ticks * self.step

    def close(self) -> None:
        """Free the instance, and unload the library."""
        self.slave.freeInstance()
