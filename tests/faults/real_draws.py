"""Which fault a seed stands for, with real processes."""

from dataclasses import dataclass

import numpy as np

VICTIMS = ("orchestrator", "flight", "guard", "real", "twin", "broker", "autonomy", "source")
"""orchestrator: the program itself; flight: its process that flies the run."""
TROUBLES = (
    *("disk full", "folder read-only", "read-only from the start", "clock back", "clock on"),
    *("garbage", "foreign", "flood", "replayed", "garbage by MQTT", "garbage at the socket"),
)
"""What else goes wrong; garbage to replayed: to the guard's ports of both vehicles."""
STAGES = ("ready", "takeoff", "at_height", "goal", "land")
ALWAYS_FLIES = frozenset({"clock back", "clock on", "garbage by MQTT", "garbage at the socket"})
"""Troubles that must not even disturb the flight."""


@dataclass(frozen=True, slots=True)
class RealFault:
    """What happens, some time after a stage was entered. action: a signal, or `trouble`."""

    seed: int
    victim: str
    action: str
    stage: str
    after_s: float


def draw_signal(seed: int) -> RealFault:
    """Return the fault of a seed: a signal to a process."""
    signal = "SIGSTOP" if seed // len(VICTIMS) % 2 else "SIGKILL"
    return _drawn(seed, 22, VICTIMS[seed % len(VICTIMS)], signal)


def draw_trouble(seed: int) -> RealFault:
    """Return the trouble of a seed."""
    return _drawn(seed, 25, TROUBLES[seed % len(TROUBLES)], "trouble")


def _drawn(seed: int, stream: int, victim: str, action: str) -> RealFault:
    rng = np.random.default_rng([seed, stream])
    return RealFault(
        seed=seed,
        victim=victim,
        action=action,
        stage=STAGES[int(rng.integers(len(STAGES)))],
        after_s=round(float(rng.uniform(0.0, 3.0)), 2),
    )
