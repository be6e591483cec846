"""ROS message types and QoS <-> plain values. The driveline's own messages are encoded by `tcc_sim.messages.cdr`."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.qos import QoSProfile

from tcc_sim.errors import InputError
from tcc_sim.messages.definitions import type_parts

_NANOSECONDS = 1_000_000_000


def message_class(type_name: str) -> type:
    """The Python class of `package/msg/Name`.

    Raises
    ------
    InputError
        Not a message type, or its package is not installed.
    """
    package, short = type_parts(type_name)
    try:
        found: type = getattr(import_module(f"{package}.msg"), short)
    except (ImportError, AttributeError):
        raise InputError(f"message type {type_name} is not installed") from None
    return found


def time_of(nanoseconds: int) -> Time:
    """A time as messages have it; what their 32 bits of seconds do not hold, from 2038 on, is their last second."""
    sec, nanosec = divmod(nanoseconds, _NANOSECONDS)
    return Time(sec=min(sec, 2**31 - 1), nanosec=nanosec)


def qos_fields(profile: QoSProfile) -> dict[str, Any]:
    """A quality of service as rosbag2 writes it."""
    return {"history": profile.history.name.lower(), "depth": profile.depth,
            "reliability": profile.reliability.name.lower(),
            "durability": profile.durability.name.lower(), "deadline": _duration(profile.deadline.nanoseconds),
            "lifespan": _duration(profile.lifespan.nanoseconds), "liveliness": profile.liveliness.name.lower(),
            "liveliness_lease_duration": _duration(profile.liveliness_lease_duration.nanoseconds),
            "avoid_ros_namespace_conventions": profile.avoid_ros_namespace_conventions}


def _duration(nanoseconds: int) -> dict[str, int]:
    """Seconds and nanoseconds; ROS says 0 for no limit, rosbag2 the largest number."""
    sec, nsec = divmod(nanoseconds or 2**63 - 1, _NANOSECONDS)
    return {"sec": sec, "nsec": nsec}
