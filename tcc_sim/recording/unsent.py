"""Messages that the driveline could not send, as it says itself on `unsent_messages`: no gap in the numbers shows them."""

from __future__ import annotations

from typing import Any

from tcc_sim.messages import cdr

KEY = "unsent"
"""Where the recorder's result has the count."""


class UnsentCount:
    """Adds up what every driveline of a recording says of itself."""

    def __init__(self) -> None:
        self._by_publisher: dict[bytes, int] = {}

    def add(self, publisher: bytes, data: bytes) -> None:
        """Take a serialised UInt64: the count since that driveline started; what is no such message says nothing."""
        try:
            self._by_publisher[publisher] = cdr.read_uint64(data)
        except ValueError:
            return

    @property
    def total(self) -> int:
        """Messages of all drivelines."""
        return sum(self._by_publisher.values())


def unsent_sentence(result: Any) -> str | None:
    """What a recorder's result says of them, None where there were none."""
    count = result.get(KEY) if isinstance(result, dict) else None
    if isinstance(count, int) and count > 0:
        return f"{count} messages were never sent: the middleware did not take them from the driveline"
    return None
