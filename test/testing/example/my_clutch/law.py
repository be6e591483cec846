from collections import deque


class HoldSlip:
    """Actuation pressure (Pa) that holds the slip speed's mean (rad/s) over a period of excitation: PI."""

    def __init__(self, target: float = 20.0) -> None:
        self.target = target
        self.integral = 90e3
        self.cycle: deque[float] = deque(maxlen=42)

    def measure(self, slip_speed: float) -> None:
        """Take a sample; they come at 1 kHz."""
        self.cycle.append(slip_speed)

    def pressure(self, period: float) -> float:
        """Answer once in `period` seconds."""
        error = sum(self.cycle) / len(self.cycle) - self.target
        self.integral += 5.2e3 * period * error
        return min(max(self.integral + 1.4e3 * error, 0.0), 600e3)

    def update(self, slip_speed: float) -> float:
        """Take a sample and answer it."""
        self.measure(slip_speed)
        return self.pressure(1e-3)
