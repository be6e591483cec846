"""The groups of scene keys: Table 1 of Duan and Singh, with units and allowed ranges.

Every field of a group is a scene key, `group.field`. SI units, angles in rad. The defaults are those of Fig. 2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tcc_sim.errors import InputError, OutOfRange
from tcc_sim.model.quantity import Group, apart, quantity, times_of, values_over

if TYPE_CHECKING:
    from tcc_sim.model.friction import Stribeck
    from tcc_sim.model.friction_curve import FrictionCurve

FIG02_PRESSURE = 500.0 / (0.24 * 0.08 * 0.1)
"""Mean pressure, Pa, at which Tsm = 500 N m with mu_k = 0.8 mu_s, as the caption of Fig. 2 states."""
PRESSURE_MAXIMUM, TORQUE_MAXIMUM = 1e7, 1e5
LARGEST_RATIO = 20.0
"""Upper bound of mu_s/mu_k and of mu_k/mu_s."""

TABULATED = ("friction.static_coefficient", "friction.kinetic_coefficient", "friction.decay")
"""Keys that a friction table replaces."""
TABLE = ("friction.slip_speeds", "friction.coefficients")
"""Keys of a friction table."""


@dataclass(frozen=True)
class Driveline(Group):
    """Linear part of equations (1): two inertias, and the spring and damper between plate and far end."""

    flywheel_inertia: float = quantity(0.20, "flywheel inertia I1", "kg m^2", 1e-6, 1e3, label="flywheel inertia $I_1$")
    plate_inertia: float = quantity(0.02, "clutch plate inertia I2 (friction shoe and pressure plate)", "kg m^2", 1e-6,
                                    1e3, label="clutch plate inertia $I_2$")
    damping: float = quantity(0.6, "driveline viscous damping C23", "N m s/rad", 0.0, 1e4,
                              label="driveline damping $C_{23}$")
    stiffness: float = quantity(3000.0, "driveline stiffness K23", "N m/rad", 1e-3, 1e8,
                                label="driveline stiffness $K_{23}$")


@dataclass(frozen=True)
class Converter(Group):
    """Torque converter in parallel with the clutch: the torque that its fluid carries near the coupling point."""

    coupling: float = quantity(0.0, "torque of the converter's fluid per slip speed, beside the clutch", "N m s/rad",
                               0.0, 1e3, live=True, label="fluid coupling $b$")


@dataclass(frozen=True)
class Friction(Group):
    """Friction law: (6) set-valued, (7) smoothed."""

    law: str = quantity("smoothed", "friction law: (7) smoothed or (6) set_valued", choices=("smoothed", "set_valued"),
                        otherwise="; laws with memory, such as LuGre, are not modelled: sweep over friction "
                        "tables instead")
    static_coefficient: float = quantity(0.3, "static friction coefficient mu_s", "", 1e-6, 2.0, live=True,
                                         label=r"static friction coefficient $\mu_s$")
    kinetic_coefficient: float = quantity(0.24, "kinetic friction coefficient mu_k, of fast slip", "", 1e-6, 2.0,
                                          live=True, label=r"kinetic friction coefficient $\mu_k$")
    decay: float = quantity(2.0, "decay alpha of the friction coefficient with slip speed", "s/rad", 0.0, 1e3,
                            label=r"decay of friction $\alpha$")
    smoothing: float = quantity(50.0, "smoothing factor sigma of law (7)", "s/rad", 1.0, 1e12,
                                label=r"smoothing factor $\sigma$")
    slip_speeds: tuple[float, ...] = quantity((), "slip speeds of the friction table, the first 0", "rad/s", 0.0, 1e4,
                                              live=True)
    coefficients: tuple[float, ...] = quantity((), "friction coefficients of the table at these slip speeds; "
                                               "friction.static_coefficient, kinetic_coefficient and decay are then "
                                               "not used", "", 1e-6, 2.0, live=True)

    @property
    def curve(self) -> FrictionCurve | None:
        """Fit of the friction table; None without one."""
        if not (self.slip_speeds or self.coefficients):
            return None
        from tcc_sim.model.friction_curve import fit_curve

        return fit_curve(self.slip_speeds, self.coefficients)

    @property
    def sliding(self) -> FrictionCurve:
        """The sliding coefficient: fit of the table, or the law with one exponential of mu_s, mu_k and alpha."""
        from tcc_sim.model.friction_curve import FrictionCurve

        pairs = [] if self.stribeck is None else list(zip(self.stribeck[::2], self.stribeck[1::2]))
        return self.curve or FrictionCurve(self.kinetic, tuple(c * self.kinetic for c, _ in pairs),
                                           tuple(a for _, a in pairs))

    @property
    def doubts(self) -> list[str]:
        """Warning about a poor fit of the friction table, as a list of at most one sentence."""
        from tcc_sim.model.friction_curve import DOUBTFUL

        curve = self.curve
        if curve is None or max(curve.error, curve.error_between) <= DOUBTFUL:
            return []
        if curve.error > DOUBTFUL:
            return [f"the fit of the friction table is {curve.error:.1%} of its largest coefficient off at "
                    f"{curve.worst:g} rad/s, more than {DOUBTFUL:.0%}: smooth the table, or give more points where it "
                    "bends"]
        return [f"the fit of the friction table is {curve.error_between:.1%} of its largest coefficient away from a "
                f"monotone interpolation at {curve.worst_between:g} rad/s, between two points, more than "
                f"{DOUBTFUL:.0%}: give more points there"]

    @property
    def static(self) -> float:
        """mu_s, the coefficient at v = 0."""
        curve = self.curve
        return self.static_coefficient if curve is None else float(curve.at(0.0))

    @property
    def kinetic(self) -> float:
        """mu_k, the coefficient that fast slip tends to."""
        curve = self.curve
        return self.kinetic_coefficient if curve is None else curve.constant

    @property
    def stribeck(self) -> Stribeck:
        """The exponentials of mu(v)/mu_k, see `model.friction`; None where it is 1."""
        curve = self.curve
        if curve is not None:
            return curve.stribeck
        ratio = self.static_coefficient / self.kinetic_coefficient
        return (ratio - 1.0, self.decay) if ratio != 1.0 else None

    def check_together(self) -> None:
        """Raise InputError unless mu_s/mu_k is 1/20 to 20, or the table can be fitted."""
        if self.curve is not None:
            return
        low, high = self.static_coefficient / LARGEST_RATIO, self.static_coefficient * LARGEST_RATIO
        if not low <= self.kinetic_coefficient <= high:
            raise OutOfRange(f"friction.kinetic_coefficient is {apart(self.kinetic_coefficient, low, high)}; it must "
                             f"be {low:g} to {high:g}, one twentieth to twenty times friction.static_coefficient")


@dataclass(frozen=True)
class Clutch(Group):
    """Geometry of the clutch, which relates pressure and torque."""

    area: float = quantity(0.08, "pressure area A", "m^2", 1e-6, 10.0, label="pressure area $A$")
    radius: float = quantity(0.1, "friction moment arm R", "m", 1e-6, 10.0, label="moment arm $R$")


@dataclass(frozen=True)
class Excitation(Group):
    """Part of the excitation, given by the scene or by commands on a topic."""

    source: str = quantity("harmonic", "source of this input: the scene, or commands", choices=("harmonic", "topic"))
    fallback: str = quantity("mean", "with source topic, the input until the first command and after a time-out: "
                             "the mean, or the scene's own harmonic excitation at simulation time",
                             choices=("mean", "harmonic"))

    @property
    def harmonic(self) -> bool:
        """Whether the harmonic excitation of the scene ever applies: always, or as the fallback for commands."""
        return "harmonic" in (self.source, self.fallback)


@dataclass(frozen=True)
class Engine(Excitation):
    """Engine torque Te = Tm + Tp sin(omega t) + sum over n >= 2 of Tpn sin(n omega t + phi_n), Section 2.2."""

    mean_torque: float = quantity(300.0, "mean engine torque Tm", "N m", -TORQUE_MAXIMUM, TORQUE_MAXIMUM, live=True,
                                  label="mean engine torque $T_m$")
    torque_amplitude: float = quantity(250.0, "amplitude Tp of the first harmonic", "N m", 0.0, TORQUE_MAXIMUM,
                                       live=True, label="engine torque amplitude $T_p$")
    frequency: float = quantity(150.0, "angular frequency omega of the first harmonic; a period of excitation is 2 "
                                "pi/omega", "rad/s", 1e-3, 1e5, live=True, label=r"engine frequency $\omega$")
    order: float = quantity(1.0, "periods of the excitation in a crank revolution, which makes orders crank orders: 2 "
                            "for a four-cylinder four-stroke engine", "", 0.1, 100.0)
    harmonic_amplitudes: tuple[float, ...] = quantity((), "amplitudes of harmonics 2, 3, ... of omega", "N m",
                                                      0.0, TORQUE_MAXIMUM)
    harmonic_phases: tuple[float, ...] = quantity((), "phases of harmonics 2, 3, ... of omega", "rad", -100.0, 100.0)
    frequency_times: tuple[float, ...] = times_of("engine.frequency")
    frequency_values: tuple[float, ...] = values_over("engine.frequency", "omega", "rad/s", 1e-3, 1e5)
    mean_torque_times: tuple[float, ...] = times_of("engine.mean_torque")
    mean_torque_values: tuple[float, ...] = values_over("engine.mean_torque", "Tm", "N m", -TORQUE_MAXIMUM,
                                                      TORQUE_MAXIMUM)
    torque_amplitude_times: tuple[float, ...] = times_of("engine.torque_amplitude")
    torque_amplitude_values: tuple[float, ...] = values_over("engine.torque_amplitude", "Tp", "N m", 0.0,
                                                          TORQUE_MAXIMUM)
    harmonic_amplitudes_times: tuple[float, ...] = times_of("engine.harmonic_amplitudes")
    harmonic_amplitudes_values: tuple[float, ...] = values_over(
        "engine.harmonic_amplitudes", "amplitudes of harmonics 2, 3, ... at the first time, then at the next",
        "N m", 0.0, TORQUE_MAXIMUM)

    def check_together(self) -> None:
        """Raise InputError unless the lists of profiles and harmonics have matching lengths."""
        self.check_profile("frequency")
        self.check_profile("mean_torque")
        self.check_profile("torque_amplitude")
        self.check_profile("harmonic_amplitudes", len(self.harmonic_phases))
        if len(self.harmonic_amplitudes) != len(self.harmonic_phases):
            raise InputError(f"engine.harmonic_phases has {len(self.harmonic_phases)} values; it must have as many as "
                             f"engine.harmonic_amplitudes, {len(self.harmonic_amplitudes)}")
        if len(self.harmonic_amplitudes) > 32:
            raise InputError(f"engine.harmonic_amplitudes has {len(self.harmonic_amplitudes)} values; at most 32 are "
                             "allowed")


@dataclass(frozen=True)
class Pressure(Excitation):
    """Actuation pressure P = Pm + Pp sin(omega_f t + psi), equation (3), never below 0."""

    mean: float = quantity(FIG02_PRESSURE, "mean pressure Pm", "Pa", 0.0, PRESSURE_MAXIMUM, live=True,
                           label="mean pressure $P_m$")
    amplitude: float = quantity(FIG02_PRESSURE / 5.0, "pressure amplitude Pp; the sum is clamped at 0", "Pa", 0.0,
                                PRESSURE_MAXIMUM, live=True, label="pressure amplitude $P_p$")
    frequency_ratio: float = quantity(1.0, "omega_f/omega", "", 1e-6, 100.0, live=True,
                                      label=r"pressure frequency $\omega_f/\omega$")
    phase: float = quantity(0.0, "pressure phase psi relative to the engine torque", "rad", -100.0, 100.0, live=True,
                            label=r"pressure phase $\psi$")
    mean_times: tuple[float, ...] = times_of("pressure.mean")
    mean_values: tuple[float, ...] = values_over("pressure.mean", "Pm", "Pa", 0.0, PRESSURE_MAXIMUM)
    time_constant: float = quantity(0.0, "time constant of the first-order lag from the commanded pressure to the "
                                    "pressure at the plates", "s", 0.0, 100.0)
    delay: float = quantity(0.0, "dead time of the commanded pressure, a whole number of ticks", "s", 0.0, 10.0)
    rate_limit: float = quantity(0.0, "largest change of the pressure at the plates in a second; 0 is no limit", "Pa/s",
                                 0.0, 1e12)

    @property
    def lagged(self) -> bool:
        """Whether the pressure at the plates varies while a command is held."""
        return self.time_constant > 0.0 or self.rate_limit > 0.0

    @property
    def actuated(self) -> bool:
        """Whether an actuator changes the commanded pressure."""
        return self.lagged or self.delay > 0.0

    def check_together(self) -> None:
        """Raise InputError unless the profile has as many values as times, and an actuator has commands to follow."""
        self.check_profile("mean")
        if self.actuated and (self.harmonic or self.mean_times):
            name = next(name for name in ("time_constant", "delay", "rate_limit") if getattr(self, name))
            raise InputError(f"pressure.{name} is {getattr(self, name):g}; it acts on commanded pressure and needs "
                             "pressure.source topic, pressure.fallback mean and no pressure.mean_times")


@dataclass(frozen=True)
class Initial(Group):
    """Initial state; the default is (13) with Omega_e = 150 rad/s. The flywheel angle starts at the plate angle."""

    slip_speed: float = quantity(150.0, "initial slip speed", "rad/s", -1e5, 1e5,
                                 label=r"initial slip speed $\dot\delta_1$")
    plate_angle: float = quantity(0.0, "initial plate angle theta2", "rad", -1e3, 1e3,
                                  label=r"initial plate angle $\delta_2$")
    plate_speed: float = quantity(0.0, "initial plate speed", "rad/s", -1e5, 1e5,
                                  label=r"initial plate speed $\dot\delta_2$")
