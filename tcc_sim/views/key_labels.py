"""Labels of axes for scene keys: name, symbol of the paper, and unit."""

from __future__ import annotations

from tcc_sim.model.elements import list_of
from tcc_sim.model.parameters import QUANTITIES

NAMES = {
    "driveline.flywheel_inertia": "flywheel inertia $I_1$", "driveline.plate_inertia": "clutch plate inertia $I_2$",
    "driveline.damping": "driveline damping $C_{23}$", "driveline.stiffness": "driveline stiffness $K_{23}$",
    "friction.static_coefficient": r"static friction coefficient $\mu_s$",
    "friction.kinetic_coefficient": r"kinetic friction coefficient $\mu_k$",
    "friction.decay": r"decay of friction $\alpha$", "friction.smoothing": r"smoothing factor $\sigma$",
    "clutch.area": "pressure area $A$", "clutch.radius": "moment arm $R$",
    "engine.mean_torque": "mean engine torque $T_m$", "engine.torque_amplitude": "engine torque amplitude $T_p$",
    "engine.frequency": r"engine frequency $\omega$",
    "pressure.mean": "mean pressure $P_m$", "pressure.amplitude": "pressure amplitude $P_p$",
    "pressure.frequency_ratio": r"pressure frequency $\omega_f/\omega$", "pressure.phase": r"pressure phase $\psi$",
    "initial.slip_speed": r"initial slip speed $\dot\delta_1$",
    "initial.plate_angle": r"initial plate angle $\delta_2$",
    "initial.plate_speed": r"initial plate speed $\dot\delta_2$",
}


def label_of(key: str) -> str:
    """Return the label of an axis over a scene key, such as "mean pressure $P_m$ (Pa)"."""
    unit = QUANTITIES[list_of(key)].unit if list_of(key) in QUANTITIES else ""
    name = NAMES.get(key, key)
    return f"{name} ({unit})" if unit else name
