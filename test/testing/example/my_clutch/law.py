from collections import deque


class HoldSlip:
    """Actuation pressure (Pa) that holds the slip speed's mean (rad/s) over a period of excitation: PI, at 1 kHz."""

    def __init__(self, target: float = 20.0) -> None:
        self.target = target
        self.integral = 90e3
        self.cycle: deque[float] = deque(maxlen=42)

    def update(self, slip_speed: float) -> float:
        self.cycle.append(slip_speed)
        error = sum(self.cycle) / len(self.cycle) - self.target
        self.integral += 5.2 * error
        return min(max(self.integral + 1.4e3 * error, 0.0), 600e3)
