"""Quality of service: what the nodes offer and ask for."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile

COMMANDS = QoSProfile(depth=100)
"""What the driveline asks of those who send commands; reliable and volatile, as all where nothing else is said."""

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Whoever subscribes later still gets the last one."""

CHANGES = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Whoever subscribes later still gets the last thousand, none of which replaces the one before."""

DIAGNOSTICS = QoSProfile(depth=10)
"""For /diagnostics, as diagnostic_aggregator expects it."""


def states(depth: int) -> QoSProfile:
    """What the driveline offers: nothing is lost as long as a subscriber falls back by less than `depth` messages.

    With depth 0 all are kept, so that the driveline waits for a slow subscriber.
    """
    return QoSProfile(history=HistoryPolicy.KEEP_LAST if depth else HistoryPolicy.KEEP_ALL, depth=depth)
