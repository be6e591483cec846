"""A ROS domain where nobody else is on this machine. Free of rclpy."""

from __future__ import annotations

import os
import secrets
import socket
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path

from tcc_sim.errors import TccError

DOMAINS = range(1, 102)
"""Those of which a choice is made; up to 101 they keep clear of the ephemeral ports of Linux."""
_FIRST_PORT, _PORTS = 7400, 250
"""UDP ports of a domain, as the standard of DDS has them."""


def ports_in_use(tables: Iterable[Path] = (Path("/proc/net/udp"), Path("/proc/net/udp6"))) -> set[int]:
    """UDP ports that are bound on this machine; none where it does not say."""
    found: set[int] = set()
    for table in tables:
        with suppress(OSError):
            found.update(int(line.split()[1].rpartition(":")[2], 16) for line in table.read_text().splitlines()[1:])
    return found


class Domain:
    """A domain with a name that only one process on this machine may have, until it is closed or the process ends.

    A participant binds ports of its domain, so a domain with a bound port is somebody's. The name keeps those apart who
    choose at the same time and have no participant yet.

    Parameters
    ----------
    domains : those of which a choice is made

    Raises
    ------
    TccError
        Every domain is taken.
    """

    def __init__(self, domains: Sequence[int] = DOMAINS) -> None:
        self._guard = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        taken = {(port - _FIRST_PORT) // _PORTS for port in ports_in_use()}
        for number in secrets.SystemRandom().sample(domains, len(domains)):
            if number not in taken:
                with suppress(OSError):
                    self._guard.bind(f"\0tcc_sim_domain_{number}")
                    self.number = number
                    return
        self._guard.close()
        raise TccError(f"every ROS domain from {domains[0]} to {domains[-1]} is in use on this machine; set "
                       "ROS_DOMAIN_ID")

    def close(self) -> None:
        """Let others have it."""
        self._guard.close()


class OwnEnvironment:
    """The environment with discovery kept on this machine and a domain of one's own, unless the user has chosen one.

    Attributes
    ----------
    values : for child processes, as long as this is not closed
    """

    def __init__(self) -> None:
        self.values = dict(os.environ)
        self.values.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        self._domain = None if "ROS_DOMAIN_ID" in self.values else Domain()
        if self._domain is not None:
            self.values["ROS_DOMAIN_ID"] = str(self._domain.number)

    def close(self) -> None:
        """Let others have the domain."""
        if self._domain is not None:
            self._domain.close()
