"""The paper's closed forms: (8) to (18) and (24) to (29). Pure stick and pure slip are worked out in files of their
own.
"""

from tcc_sim.model.pure_slip import PureSlip, damped_pair, equivalent_torque, pure_slip, slip_torque
from tcc_sim.model.pure_stick import (
    StickLimits,
    StickMargin,
    constant_load_limits,
    interface_gain,
    interface_phase,
    interface_torque,
    plate_angle,
    regime_boundary,
    stick_limits,
    stick_margin,
    stick_phase,
)
from tcc_sim.model.sines import Sines, common_cycles, engine_series, load_series

__all__ = ["PureSlip", "Sines", "StickLimits", "StickMargin", "common_cycles", "constant_load_limits", "damped_pair",
           "engine_series", "equivalent_torque", "interface_gain", "interface_phase", "interface_torque",
           "load_series", "plate_angle", "pure_slip", "regime_boundary", "slip_torque", "stick_limits",
           "stick_margin", "stick_phase"]
