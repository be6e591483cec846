"""Explain a scene: estimates, friction law, closed forms of the paper (pure slip (12) to (18), pure stick (8) to (11)),
terms, kernel, modules and topics in use and left out, and the cost of a step.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import FunctionType, ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from tcc_sim.errors import InputError
from tcc_sim.model.closed_forms import plate_angle, pure_slip, stick_margin
from tcc_sim.model.friction import smoothed_coefficient
from tcc_sim.model.parameters import System
from tcc_sim.model.profile import Origin
from tcc_sim.output.estimates import Estimates, estimates_of
from tcc_sim.output.tables import friction_formula
from tcc_sim.result import Described, json_of, reported, result_class
from tcc_sim.scene import Scene
from tcc_sim.shown_units import speed
from tcc_sim.solvers import choose
from tcc_sim.solvers.terms import (
    Terms,
    for_ticks,
    held_and_left_out,
    padded,
    stick_speed_of,
    substeps,
    terms_from,
    terms_of,
)
from tcc_sim.topics import TOPICS

OPTIONAL_MODULES = ("scipy", "mcap", "matplotlib", "rerun", "rclpy", "distributed")
"""Optional packages, which only some scenes and verbs need."""
TICK = 1e-3
"""Length of a tick for the cost and for the comparison with closed forms, s."""
COMPARED = 500
"""Number of ticks compared with a closed form."""
ROUNDS, TICKS = 10, 400
"""Measurements of the run time of each kernel, and ticks in a measurement."""
STRIBECK = "Stribeck exponential"
"""Term whose cost is measured by removing or adding it; the sines are in every kernel of ticks."""
FUNCTIONS = {"sin": "sines", "exp": "exponentials", "tanh": "hyperbolic tangents"}
"""Costly functions of NumPy that the kernels call, with their printed names."""


@result_class
class Held:
    """Names in use, and names left out, by a scene."""

    held: Sequence[str] = reported("names of those that the scene uses")
    left_out: Sequence[str] = reported("names of those that it leaves out")


@result_class
class StepFigures:
    """A tick of the real-time solver."""

    tick_s: float = reported("tick", "s")
    sub_steps: int = reported("sub-steps in a tick")
    own_calls: Mapping[str, float] = reported("function calls in a sub-step")
    general_calls: Mapping[str, float] = reported("those with three exponentials and a profile")
    own_s: float | None = reported("time of a tick, with --cost", "s", optional=True, default=None)
    general_s: float | None = reported("that with three exponentials and a profile", "s", optional=True, default=None)
    ratio: float | None = reported("general_s over own_s", optional=True, default=None)
    noise_s: float | None = reported(
        "noise of these times; differences below twice this are null", "s", optional=True, default=None)
    terms_s: Mapping[str, float | None] | None = reported(
        "time that the exponential, if held, adds to a tick", "s", optional=True, default=None)
    saved_s: Mapping[str, float | None] | None = reported(
        "time that the exponential, if left out, would add", "s", optional=True, default=None)


@result_class
class FrictionFigures:
    """Sliding coefficient mu(v) = constant + sum of amplitudes exp(-rates |v|)."""

    constant: float = reported("coefficient that fast slip tends to")
    amplitudes: Sequence[float] = reported("amplitudes of the exponentials")
    rates: Sequence[float] = reported("rates of the exponentials", "s/rad")
    fit_error: float | None = reported(
        "largest error of a table's fit, relative to its largest coefficient; null without one")
    fit_error_at: float | None = reported("its slip speed", "rad/s")
    fit_error_between: float | None = reported(
        "largest difference from a monotone interpolation of the table, likewise")
    fit_error_between_at: float | None = reported("its slip speed", "rad/s")
    slip_speeds: tuple[float, float] = reported(
        "first and last slip speed of the table, or as far as the exponential lasts", "rad/s")
    coefficients: tuple[float, float] = reported("coefficients there")
    slopes: tuple[float, float] = reported("least and largest slope of the coefficient between them", "s/rad")
    stick_speed: float = reported("slip speed up to which the law counts as stick; 0 if set-valued", "rad/s")
    largest_coefficient: float = reported("largest one up to the stick speed")


@result_class
class PureSlipFigures:
    """Pure slip (12) to (18) in the direction of the initial slip."""

    direction: int = reported("sign of the initial slip speed")
    mean: float | None = reported("a0 of (15)", "rad/s")
    amplitude: float = reported("|a21| + |a22| of (15)", "rad/s")
    growth: float = reported("a1", "rad/s^2")
    margin: float | None = reported("margin of (16)", "rad/s")
    least: float | None = reported("smallest slip speed with the transient; null if the slip ends", "rad/s")
    least_is_bound: bool = reported("whether `least` is only a lower bound")
    pure_slip: bool | None = reported("whether it lasts for ever; null if the bound does not decide")
    tick_difference: float | None = reported(
        "largest difference of the real-time solver from (14) in 500 ticks", "rad/s")


@result_class
class PureStickFigures:
    """Pure stick (8) to (11)."""

    margin: float = reported("margin of (10)", "N m")
    sticks: bool = reported("whether pure stick is possible")
    mean: float = reported("mean plate angle (8)", "rad")
    amplitude: float = reported("amplitude of the plate angle (8)", "rad")


@result_class
class ClosedForms:
    """Closed forms of the paper."""

    slip: PureSlipFigures | None = reported("pure slip (12) to (18); null without such a closed form")
    stick: PureStickFigures | None = reported("pure stick (8) to (11); null likewise")
    slip_why: str = reported("why `slip` is null")
    stick_why: str = reported("why `stick` is null")


@result_class
class SceneExplanation(Described):
    """Expected behaviour of a scene, and its terms, topics and packages in use and left out."""

    name: str = reported("name of the scene")
    description: str = reported("of the scene")
    solver: str = reported("solver that auto takes offline")
    estimates: Estimates = reported("estimates from the parameters alone")
    terms: Held = reported("terms of the equations")
    kernel: Mapping[str, str] = reported("type of every term as the compiler has it")
    topics: Held = reported("topics of the driveline node")
    modules: Held = reported("optional packages")
    step: StepFigures | None = reported("tick of the real-time solver; null for the set-valued law")
    closed_forms: dict[str, Any] | None = reported(
        "closed forms of the paper; null where a torque comes from a topic", of=(ClosedForms,))
    friction: dict[str, Any] = reported(
        "sliding coefficient mu(v) = constant + sum of amplitudes exp(-rates |v|)", of=(FrictionFigures,))


def explained(scene: Scene, *, cost: bool = False) -> SceneExplanation:
    """Explain a scene.

    cost : measure the run time of a tick too: with this scene's kernel, with that of all terms, and without or with
        the Stribeck exponential
    """
    terms = terms_of(scene.system)
    needed = [row.name for row in TOPICS if row.wanted(scene.value)]
    topics = Held(needed, [row.name for row in TOPICS if row.name not in needed and row.direction != "other"])
    step = None
    if terms.smoothing is not None:
        figures: dict[str, Any] = {**count_calls(scene.system), **(_cost(scene) if cost else {})}
        step = StepFigures(TICK, substeps(terms, TICK), **figures)
    return SceneExplanation(
        scene.name, scene.description, choose(scene.system, "auto"), estimates_of(scene.system),
        Held(*held_and_left_out(terms)), {name: _what_is(value) for name, value in zip(terms._fields, terms)}, topics,
        Held([], OPTIONAL_MODULES),  # No solver of this package imports them.
        step, closed_forms(scene.system), friction_of(scene.system))


def friction_of(system: System) -> dict[str, Any]:
    """Return the friction law: the fields of `FrictionFigures` as JSON values."""
    friction = system.friction
    stick = stick_speed_of(terms_of(system))
    largest = friction.static if stick == 0.0 else friction.kinetic * float(
        smoothed_coefficient(stick, friction.smoothing, friction.stribeck))
    curve, v = friction.sliding, friction.sliding.speeds
    fit = [None] * 4 if friction.curve is None else [curve.error, curve.worst, curve.error_between, curve.worst_between]
    slopes = curve.slope(v)
    return dict(json_of(FrictionFigures(
        curve.constant, curve.amplitudes, curve.rates, fit[0], fit[1], fit[2], fit[3], (0.0, float(v[-1])),
        (float(curve.at(0.0)), curve.constant if friction.curve is None else float(curve.at(v[-1]))),
        (float(slopes.min()), float(slopes.max())), stick, largest)))


def friction_lines(law: dict[str, Any]) -> list[str]:
    """Return the lines of the friction law."""
    formula = friction_formula(law["constant"], law["amplitudes"], law["rates"])
    (static, last), (least, most), fast = law["coefficients"], law["slopes"], law["slip_speeds"][1]
    tabulated = law["fit_error"] is not None
    course = ("does not depend on slip speed" if least == most == 0.0 else
              f"falls and rises between {static:.4g} without slip and {last:.4g}" if least < 0.0 < most else
              f"{'falls' if least < 0.0 else 'rises'} with slip speed from {static:.4g} to {last:.4g}")
    at = f" at {speed(fast)}, the end of the table" if tabulated else ""
    lines = [f"sliding friction: {formula}", f"  the coefficient {course}{at}; its slope is "
             + (f"{least:.3g} to {most:.3g} s/rad" if least < most else f"{least:.3g} s/rad")]
    if tabulated:
        lines.append(f"  largest error of the fit {law['fit_error']:.2%} of the largest coefficient of the table, at "
                     f"{speed(law['fit_error_at'])}; between the points {law['fit_error_between']:.2%} from a "
                     f"monotone interpolation, at {speed(law['fit_error_between_at'])}")
    if law["stick_speed"] > 0.0:
        lines.append(f"  smoothed through 0: slip speeds up to {speed(law['stick_speed'], 4)} count as stick; "
                     f"largest coefficient {law['largest_coefficient']:.4g}")
    return lines


def _what_is(value: object) -> str:
    if value is None:
        return "left out"
    if isinstance(value, np.ndarray):
        return f"array of {' by '.join(map(str, value.shape))} numbers"
    return f"{len(value)} numbers" if isinstance(value, tuple) else "number"


def with_all_terms(system: System) -> Terms:
    """Return the terms with three exponentials and a profile, which have no effect where `system` lacks them."""
    terms = terms_from(system, Origin(phase=2.0 * np.pi))
    return terms._replace(stribeck=padded(terms.stribeck))


def count_calls(system: System) -> dict[str, dict[str, float]]:
    """Count the calls of costly functions per sub-step of the first tick, with the kernel run as Python."""
    from tcc_sim.solvers.fixed_step import Stepper, advance

    calls: dict[str, dict[str, float]] = {}
    for which, terms in (("own_calls", terms_of(system)), ("general_calls", with_all_terms(system))):
        stepper, counts = Stepper(system, TICK), Counter[str]()
        n, counted = stepper.substeps, {name: partial(_counted, name, counts) for name in FUNCTIONS}
        run = _interpreted(advance, SimpleNamespace(**{**vars(np), **counted}), {})
        run(stepper.state, 0.0, TICK / n, n, for_ticks(terms), None)
        calls[which] = {words: counts[name] / n for name, words in FUNCTIONS.items()}
    return calls


def _counted(name: str, counts: Counter[str], x: Any) -> Any:
    counts[name] += 1
    return getattr(np, name)(x)


def _interpreted(kernel: Any, numpy: Any, known: dict[Any, Any]) -> Callable[..., Any]:
    """Return a kernel, and all kernels that it calls, as Python functions with another NumPy."""
    if kernel not in known:
        names = {**kernel.py_func.__globals__, "np": numpy}
        known[kernel] = FunctionType(kernel.py_func.__code__, names)
        used = kernel.py_func.__code__.co_names
        for name in used:
            if isinstance(names.get(name), ModuleType):  # A module of kernels.
                names[name] = SimpleNamespace(**{
                    key: _interpreted(each, numpy, known) if hasattr(each, "py_func") else each
                    for key, each in vars(names[name]).items() if key in used})
            elif hasattr(names.get(name), "py_func"):
                names[name] = _interpreted(names[name], numpy, known)
            elif isinstance(names.get(name), np.ufunc):  # A kernel's own name for a function of NumPy.
                names[name] = getattr(numpy, names[name].__name__)
    out: Callable[..., Any] = known[kernel]
    return out


def _cost(scene: Scene) -> dict[str, Any]:
    """Measure the run time of a tick, s: of this scene's kernel, of one with all terms, and the share of each term.

    The kernels are measured in turns; the fastest of several measurements counts.
    """
    from tcc_sim.solvers.fixed_step import Stepper

    stepper, own = Stepper(scene.system, TICK), terms_of(scene.system)
    falls = own.stribeck is not None
    kernels = {"own": own, "general": with_all_terms(scene.system),
               "toggled": own._replace(stribeck=None if falls else (0.0, scene.system.friction.decay))}
    seconds = {name: np.empty(ROUNDS) for name in kernels}
    for turn in range(-1, ROUNDS):  # The first turn loads the kernels.
        for name, terms in kernels.items():
            began = time.thread_time()
            stepper.run_apart(terms, stepper.state, TICKS * stepper.substeps)
            seconds[name][turn] = (time.thread_time() - began) / TICKS
    best = {name: float(times.min()) for name, times in seconds.items()}
    # Noise: difference between the fastest of the even and of the odd measurements.
    noise = max(abs(float(times[::2].min() - times[1::2].min())) for times in seconds.values())
    share = max(best["own"] - best["toggled"] if falls else best["toggled"] - best["own"], 0.0)
    exponential = {STRIBECK: share if share > 2.0 * noise else None}
    return {"own_s": best["own"], "general_s": best["general"], "ratio": best["general"] / best["own"],
            "noise_s": noise, "terms_s": exponential if falls else {}, "saved_s": {} if falls else exponential}


def closed_forms(system: System) -> dict[str, Any] | None:
    """Return the fields of `ClosedForms` as JSON values; None for torques from a topic."""
    if "topic" in (system.engine.source, system.pressure.source):
        return None
    slip, slip_why = _slip(system)
    stick, stick_why = _stick(system)
    return dict(json_of(ClosedForms(slip, stick, slip_why, stick_why)))


def _slip(system: System) -> tuple[PureSlipFigures | None, str]:
    """Return pure slip in the direction of the initial slip; None and the reason without such a closed form."""
    direction = -1 if system.initial.slip_speed < 0.0 else 1
    try:
        form = pure_slip(system, direction)
    except InputError as error:
        return None, str(error)
    least = form.least_slip
    return PureSlipFigures(direction, form.a0, form.slip.swing(), form.a1, form.margin, least.value, not least.exact,
                           least.lasts, _difference(system, form.slip_speed) if least.lasts else None), ""


def _difference(system: System, slip_speed: Any) -> float | None:
    """Return the largest difference of the real-time solver from v(t), rad/s; None for the set-valued law."""
    if system.friction.law != "smoothed":
        return None
    from tcc_sim.solvers.fixed_step import Stepper

    stepper = Stepper(system, TICK)
    errors = np.empty(COMPARED)
    for k in range(COMPARED):
        stepper.advance()
        errors[k] = stepper.state[0]
    return float(np.abs(errors - slip_speed(TICK * np.arange(1, COMPARED + 1))).max())


def _stick(system: System) -> tuple[PureStickFigures | None, str]:
    try:
        margin, angle = stick_margin(system), plate_angle(system)
    except InputError as error:
        return None, str(error)
    return PureStickFigures(margin.torque, margin.sticks, angle.mean, angle.swing()), ""


def closed_form_lines(closed: dict[str, Any] | None) -> list[str]:
    """Return the lines of the closed forms."""
    if closed is None:
        return ["closed forms: none, because a torque comes from a topic"]
    slip, stick = closed["slip"], closed["stick"]
    lines = ["closed forms"]
    if slip is None:
        lines.append(f"  pure slip (12) to (18): none: {closed['slip_why']}")
    else:
        lines.append(f"  pure slip (15): {speed(slip['mean'])} plus sines of {speed(slip['amplitude'])}"
                     + (f", growing by {slip['growth']:.4g} rad/s^2" if slip["growth"] else ""))
        least = "slip ends, because the friction torque outweighs the engine torque"
        if slip["least"] is not None:
            lasts = {True: "so pure slip lasts for ever", False: "so pure slip does not last",
                     None: "which does not decide whether pure slip lasts"}[slip["pure_slip"]]
            least = (f"smallest slip speed with the transient {'at least ' if slip['least_is_bound'] else ''}"
                     f"{speed(slip['least'])}, {lasts}")
        lines.append(f"    margin of (16) {speed(slip['margin'])}; {least}")
        if slip["tick_difference"] is not None:
            lines.append(f"    the real-time solver is within {speed(slip['tick_difference'], 2)} of (14) over "
                         f"{COMPARED} ticks")
    if stick is None:
        lines.append(f"  pure stick (8) to (11): none: {closed['stick_why']}")
    else:
        possible = "is possible" if stick["sticks"] else "is not possible"
        lines.append(f"  pure stick (10): margin {stick['margin']:.6g} N m, so pure stick {possible}; plate "
                     f"angle (8) {stick['mean']:.6g} rad plus sines of {stick['amplitude']:.6g} rad")
    return lines
