"""What an operator can ask of a run, from wherever the wish comes."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

OperatorKind = Literal["abort", "hold", "resume", "geofence"]


@dataclass(frozen=True, slots=True)
class OperatorCommand:
    """A wish of a person: what, who, and for the record why.

    document: for geofence, what the new fences are: the text of YAML, a plan or GeoJSON.
    command_id: by which it is answered, where the answer takes time.
    """

    kind: OperatorKind
    who: str
    reason: str = ""
    document: str = ""
    command_id: str = ""


class Inbox(Protocol):
    """Where a run looks for commands, often and without waiting."""

    def poll(self) -> OperatorCommand | None:
        """Return the next command that has come, or None."""


class ScriptedInbox:
    """Commands that come at given times of the run clock: for tests and for virtual time."""

    def __init__(
        self, *, time: Callable[[], float], script: tuple[tuple[float, OperatorCommand], ...] = ()
    ) -> None:
        self._time = time
        self._script = deque(sorted(script, key=lambda item: item[0]))

    def poll(self) -> OperatorCommand | None:
        """Return the next command whose time has come, or None."""
        if self._script and self._script[0][0] <= self._time():
            return self._script.popleft()[1]
        return None
