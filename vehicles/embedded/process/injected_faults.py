"""Faults that are made on purpose, as the short texts that travel over the feed."""

from typing import NamedTuple


class FaultError(ValueError):
    """A text that names no fault to inject; says which there are."""


class Fault(NamedTuple):
    """A fault to inject: `kill`, `mute`, `unmute`, or `motor` with index and remaining thrust."""

    name: str
    motor: int = 0
    factor: float = 0.0

    def __str__(self) -> str:
        """Return the injected fault as text."""
        return f"motor {self.motor} {self.factor}" if self.name == "motor" else self.name


def parse_fault(text: str) -> Fault:
    """Return the fault in a text: "kill", "mute", "unmute", "motor 2 0.5". Raises FaultError."""
    name, *rest = text.split()[:4] or [""]
    if name in {"kill", "mute", "unmute"} and not rest:
        return Fault(name)
    if name == "motor" and len(rest) == 2:
        try:
            motor, factor = int(rest[0]), float(rest[1])
        except ValueError:
            motor, factor = -1, 0.0
        if 0 <= motor <= 3 and 0.0 <= factor <= 2.0:
            return Fault("motor", motor, factor)
    raise FaultError(f"{text!r} is no fault; there are kill, mute, unmute, motor 0..3 0.0..2.0")
