"""What a driver and its mavsdk process say to each other: a JSON document a line.

NaN stands in a line as NaN, which Python writes and reads.
"""

import dataclasses
import json
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field, TypeAdapter, ValidationError

from vehicles.driver.logs import LogEntry
from vehicles.driver.mission import ItemList, MissionItem

Action = Literal["hold", "land", "return_to_launch", "disarm", "terminate"]
"""Names of mavsdk's `Action`."""


class TalkError(ValueError):
    """A line that is no message."""


@dataclass(frozen=True, slots=True)
class Choose:
    """Speak to this system from now on."""

    number: int
    system_id: int
    within_s: float
    kind: Literal["choose"] = "choose"


@dataclass(frozen=True, slots=True)
class Say:
    """Send a message. fields: as JSON for MavlinkDirect. at_s: when, CLOCK_MONOTONIC."""

    name: str
    fields: str
    at_s: float
    kind: Literal["say"] = "say"


@dataclass(frozen=True, slots=True)
class Act:
    """Have `Action` do a thing."""

    number: int
    action: Action
    kind: Literal["act"] = "act"


@dataclass(frozen=True, slots=True)
class Upload:
    """Send a list of items by `MissionRaw`."""

    number: int
    which: ItemList
    items: tuple[MissionItem, ...]
    kind: Literal["upload"] = "upload"


@dataclass(frozen=True, slots=True)
class Download:
    """Read a list of items by `MissionRaw`."""

    number: int
    which: ItemList
    kind: Literal["download"] = "download"


@dataclass(frozen=True, slots=True)
class ListLogs:
    """List the logs by `LogFiles`."""

    number: int
    kind: Literal["list_logs"] = "list_logs"


@dataclass(frozen=True, slots=True)
class FetchLog:
    """Fetch a log by `LogFiles` into a file that is not there yet."""

    number: int
    entry: LogEntry
    path: str
    within_s: float
    kind: Literal["fetch_log"] = "fetch_log"


@dataclass(frozen=True, slots=True)
class Ready:
    """mavsdk runs and listens."""

    kind: Literal["ready"] = "ready"


@dataclass(frozen=True, slots=True)
class Alive:
    """The thread that speaks goes on. late: how many messages were too old to be sent."""

    late: int
    kind: Literal["alive"] = "alive"


@dataclass(frozen=True, slots=True)
class Unsaid:
    """A message that mavsdk cannot send. result: of MavlinkDirect."""

    name: str
    result: str
    kind: Literal["unsaid"] = "unsaid"


@dataclass(frozen=True, slots=True)
class Done:
    """An order was done; with what was asked for."""

    number: int
    items: tuple[MissionItem, ...] = ()
    logs: tuple[LogEntry, ...] = ()
    kind: Literal["done"] = "done"


@dataclass(frozen=True, slots=True)
class Refused:
    """An order was not done. result: mavsdk's word for why."""

    number: int
    result: str
    kind: Literal["refused"] = "refused"


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a log has come, 0 to 1."""

    number: int
    part: float
    kind: Literal["progress"] = "progress"


Order = Choose | Act | Upload | Download | ListLogs | FetchLog
ToProcess = Order | Say
FromProcess = Ready | Alive | Unsaid | Done | Refused | Progress

_TO: TypeAdapter[ToProcess] = TypeAdapter(Annotated[ToProcess, Field(discriminator="kind")])
_FROM: TypeAdapter[FromProcess] = TypeAdapter(Annotated[FromProcess, Field(discriminator="kind")])


def encode(message: ToProcess | FromProcess) -> bytes:
    """Return a message's line, with its end."""
    return json.dumps(dataclasses.asdict(message)).encode() + b"\n"


def decode_order(line: bytes) -> ToProcess:
    """Return what the driver said. Raises TalkError."""
    try:
        return _TO.validate_python(json.loads(line))
    except (ValidationError, ValueError) as error:
        raise TalkError(f"{line[:200]!r} is no message: {error}") from error


def decode_answer(line: bytes) -> FromProcess:
    """Return what the process said. Raises TalkError."""
    try:
        return _FROM.validate_python(json.loads(line))
    except (ValidationError, ValueError) as error:
        raise TalkError(f"{line[:200]!r} is no message: {error}") from error
