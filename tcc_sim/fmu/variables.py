"""The variables of an FMU: inputs, outputs, and the scene's keys as parameters, with what their metadata say."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

from tcc_sim.model.parameters import QUANTITIES, values_of
from tcc_sim.scene import Scene
from tcc_sim.solvers.terms import RESOLUTION, SUBSTEP_LIMIT
from tcc_sim.topics import topic


@dataclass(frozen=True)
class Variable:
    """One variable of an FMU; its place in the list is its reference.

    causality : independent, input, output or parameter
    variability : continuous, discrete, fixed or tunable
    start : None where it is calculated
    low, high : allowed range, `above` without the lower end; infinite where it is not checked
    kind : real or integer
    """

    name: str
    causality: str
    variability: str
    unit: str
    description: str
    start: float | None = None
    low: float = -math.inf
    high: float = math.inf
    above: bool = False
    kind: str = "real"

    @property
    def word(self) -> str:
        """Its name in C; of a list, that of the first element."""
        return "at_" + re.sub(r"\W", "_", re.sub(r"\[1\]$", "", self.name)).rstrip("_")


OUTPUTS = (
    ("slip_speed", "rad/s", "slip speed v, flywheel speed minus plate speed"),
    ("friction_torque", "N m", "friction torque on the clutch plate"),
    ("flywheel_angle", "rad", "flywheel angle theta1"), ("flywheel_speed", "rad/s", "flywheel speed"),
    ("plate_angle", "rad", "clutch plate angle theta2"), ("plate_speed", "rad/s", "clutch plate speed"),
    ("applied_engine_torque", "N m", "engine torque that acts at the end of the step"),
    ("applied_pressure", "Pa", "actuation pressure that acts at the end of the step"),
    ("shaft_torque", "N m", "torque of spring and damper, C23 theta2' + K23 theta2"))
INPUTS = "engine_torque", "actuation_pressure"


def variables(scene: Scene) -> list[Variable]:
    """The variables of a scene's FMU: time, inputs of what its topics command, outputs, and parameters.

    Reference 0 is time, which FMI 3 must have; in FMI 2 it is left out of the description, since an importer
    (FMI Library) takes it for one without a start.
    """
    found = [Variable("time", "independent", "continuous", "s", "time; that of the scene's excitation begins with 0 "
                      "at the start")]
    for name in INPUTS:
        row = topic(name)
        if row.wanted(scene.value):
            meant, start = QUANTITIES[row.key], scene.value(row.key)
            assert isinstance(start, float)
            found.append(Variable(name, "input", "continuous", meant.unit, f"{name.replace('_', ' ')}, held through "
                                  "each step", start, meant.low, meant.high))
    found += [Variable(name, "output", "continuous", unit, text) for name, unit, text in OUTPUTS]
    found.append(Variable("stick_slip_state", "output", "discrete", "", "-1 negative slip, 0 stick, 1 positive slip",
                          kind="integer"))
    return [*found, *_parameters(scene)]


def _parameters(scene: Scene) -> Iterator[Variable]:
    """The numbers of the scene; those of a list one by one."""
    for key, value in values_of(scene.system):
        meant = QUANTITIES[key]
        if isinstance(value, str) or f"{key}_times" in scene.system.varying:
            continue  # A number that a profile takes the place of has no effect.
        many = isinstance(value, tuple)
        for place, number in enumerate(value if isinstance(value, tuple) else (value,), 1):
            yield Variable(f"{key}[{place}]" if many else key, "parameter", "tunable" if meant.live else "fixed",
                           meant.unit, meant.description, number, meant.low, meant.high, meant.above)


def header(scene: Scene, rows: list[Variable], identifier: str, token: str, step: float) -> str:
    """tcc_variables.h: what the C needs to know of the scene and of its variables."""
    system = scene.system
    roles = {"input": "TCC_INPUT", "fixed": "TCC_FIXED", "tunable": "TCC_TUNABLE"}
    lines = []
    for row in rows:
        role = "TCC_CALCULATED" if row.start is None else roles[
            "input" if row.causality == "input" else row.variability]
        low, high = ("0.0" if math.isinf(bound) else repr(bound) for bound in (row.low, row.high))
        lines.append(f'    {{"{row.name}", {role}, TCC_{row.kind.upper()}, {float(row.start or 0.0)!r}, {low}, {high}, '
                     f'{int(row.above)}}}')
    places = [f"{row.word} = {place}" for place, row in enumerate(rows)
              if not re.search(r"\[(?!1\])\d+\]$", row.name)]
    # A list without elements, and what a profile takes the place of, have a place that nothing reads.
    places += [f"at_{key.replace('.', '_')} = 0" for key, value in values_of(system)
               if value == () or f"{key}_times" in system.varying]
    points = [len(times) for times in (system.engine.frequency_times, system.engine.mean_torque_times,
                                       system.pressure.mean_times)]
    settings: dict[str, float] = {
        "SUBSTEP_LIMIT": SUBSTEP_LIMIT, "RESOLUTION": RESOLUTION,
        "ENGINE_TOPIC": system.engine.source == "topic", "ENGINE_HARMONIC": system.engine.harmonic,
        "PRESSURE_TOPIC": system.pressure.source == "topic", "PRESSURE_HARMONIC": system.pressure.harmonic,
        "HARMONICS": len(system.engine.harmonic_amplitudes),
        "MOST_HARMONICS": max(1, len(system.engine.harmonic_amplitudes)),
        "FREQUENCY_POINTS": points[0], "TORQUE_POINTS": points[1], "PRESSURE_POINTS": points[2],
        "MOST_PIECES": 1 + sum(points)}
    defined = "\n".join(f"#define TCC_{name} {value + 0}" for name, value in settings.items())
    body = ",\n    ".join(places)
    return f"""\
/* {identifier}: the scene's variables and settings, written by tcc_sim. */
#define TCC_TOKEN "{token}"
#define TCC_STEP {step!r}
{defined}
#define TCC_VARIABLES {len(rows)}
typedef enum {{ TCC_CALCULATED, TCC_INPUT, TCC_FIXED, TCC_TUNABLE }} tcc_role;
typedef enum {{ TCC_REAL, TCC_INTEGER }} tcc_type;
typedef struct {{ const char *name; tcc_role role; tcc_type type; double start, low, high; int above; }} tcc_variable;
enum {{
    {body}
}};
static const tcc_variable tcc_variables[TCC_VARIABLES] = {{
{(',' + chr(10)).join(lines)}
}};
"""
