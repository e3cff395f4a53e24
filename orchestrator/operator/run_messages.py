"""What passes between a run in flight and its operator; small, frozen, picklable.

Progress reports and events, the inbox of commands, and the place that commands address.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.worlds.frames import Vec3

HappeningKind = Literal["stage", "collision", "decisive", "guard", "answer", "acknowledged"]


@dataclass(frozen=True, slots=True)
class VehicleProgress:
    """The progress of one vehicle in a run; unknown values are None."""

    name: str
    armed: bool
    mode: str
    landed: str
    position_ned_m: Vec3 | None = None
    velocity_ned_m_s: Vec3 | None = None
    battery_fraction: float | None = None


@dataclass(frozen=True, slots=True)
class RunProgressReport:
    """The progress of one run; values that do not exist yet are None.

    verdict_so_far: the verdict that an event has decided. A PASS is none before the run is judged.
    """

    case: str
    mode: str
    repetition: int
    stage: str
    t_s: float
    mixing_rate_hz: float | None = None
    skew_ms: float | None = None
    clearance_m: float | None = None
    verdict_so_far: str | None = None
    text: str = ""
    vehicles: tuple[VehicleProgress, ...] = ()

    @property
    def run(self) -> str:
        """Return the folder of the run in progress, beneath the campaign's."""
        return f"{self.case}/{self.mode}/{self.repetition}"


@dataclass(frozen=True, slots=True)
class RunEventReport:
    """An event of a run in progress, reported at once.

    kind: a stage was entered (word: which); a vehicle touched something (word: the oracle); the
    verdict is decided (word: which); an event of the guard (word: its kind); the answer to an
    operator's command (word: ok or refused), with its id; its receipt by the run (word: its kind).
    vehicle: empty when it concerns all.
    """

    run: str
    t_s: float
    kind: HappeningKind
    word: str
    vehicle: str
    text: str
    command_id: str = ""
    who: str = ""


News = RunProgressReport | RunEventReport
Report = Callable[[News], None]


class ProgressLimiter:
    """Limits the rate of a run's progress reports; its events always pass.

    A run reports its progress by its own clock, which may be thirty times as fast as the wall
    clock: reading all reports would take longer than the flight. shortest_s: between two, wall
    time.
    """

    def __init__(self, shortest_s: float) -> None:
        self._shortest_s = shortest_s
        self._next_s = 0.0

    def passes(self, message: object) -> bool:
        """Return whether a message is to be passed on now."""
        if not isinstance(message, RunProgressReport):
            return True
        now_s = time.monotonic()
        if now_s < self._next_s:
            return False
        self._next_s = now_s + self._shortest_s
        return True


class OperatorInbox(Protocol):
    """The inbox of operator commands (protocol): polled by a run, never blocking."""

    def poll(self) -> OperatorCommand | None:
        """Return the next operator command, or None."""


@dataclass(frozen=True, slots=True)
class FlightPlace:
    """A node and a test bench; both empty for this machine. str(): in words, or ""."""

    node: str = ""
    bench: str = ""

    def __str__(self) -> str:
        if not self.bench:
            return self.node
        return f"bench {self.bench} on {self.node}" if self.node else f"bench {self.bench}"

    def is_meant(self, *, node: str, bench: str) -> bool:
        """Return whether a command addresses this place; an empty node or bench addresses all."""
        return node in {"", self.node} and bench in {"", self.bench}
