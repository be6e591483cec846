from collections import deque


class PI:
    """The law with its gains as parameters, Pa s/rad and Pa/rad."""

    def __init__(self, kp: float = 1.4e3, ki: float = 5.2e3) -> None:
        self.kp, self.ki = kp, ki
        self.integral = 90e3
        self.cycle: deque[float] = deque(maxlen=42)

    def __call__(self, reading) -> float:
        self.cycle.append(reading.slip_speed)
        error = sum(self.cycle) / len(self.cycle) - 20.0
        self.integral += 1e-3 * self.ki * error
        return min(max(self.integral + self.kp * error, 0.0), 600e3)
