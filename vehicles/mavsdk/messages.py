"""What a driver and its mavsdk process send to each other, in frames on a socket."""

from typing import Literal

from vehicles.driver.onboard.mission_protocol import ItemList, MissionItem
from vehicles.driver.onboard.vehicle_logs import LogEntry
from vehicles.processes.codec import Codec, Message

Action = Literal["hold", "land", "return_to_launch", "disarm", "terminate"]
"""Names of mavsdk's `Action`."""


class Choose(Message, frozen=True):
    """Speak to this system from now on."""

    number: int
    system_id: int
    within_s: float


class SendMessage(Message, frozen=True):
    """Send a message. fields: as JSON for MavlinkDirect. at_s: when, CLOCK_MONOTONIC."""

    name: str
    fields: str
    at_s: float


class Act(Message, frozen=True):
    """Have `Action` do a thing."""

    number: int
    action: Action


class Upload(Message, frozen=True):
    """Send a list of items by `MissionRaw`."""

    number: int
    which: ItemList
    items: tuple[MissionItem, ...]


class Download(Message, frozen=True):
    """Read a list of items by `MissionRaw`."""

    number: int
    which: ItemList


class ListLogs(Message, frozen=True):
    """List the logs by `LogFiles`."""

    number: int


class FetchLog(Message, frozen=True):
    """Fetch a log by `LogFiles` into a file that is not there yet."""

    number: int
    entry: LogEntry
    path: str
    within_s: float


class Ready(Message, frozen=True):
    """mavsdk runs and listens."""


class Alive(Message, frozen=True):
    """The thread that speaks goes on. late: how many messages were too old to be sent."""

    late: int


class NotSent(Message, frozen=True):
    """A message that mavsdk cannot send. result: of MavlinkDirect."""

    name: str
    result: str


class Done(Message, frozen=True):
    """An order was done; with what was asked for."""

    number: int
    items: tuple[MissionItem, ...] = ()
    logs: tuple[LogEntry, ...] = ()


class Refused(Message, frozen=True):
    """An order was not done. result: mavsdk's word for why."""

    number: int
    result: str


class Progress(Message, frozen=True):
    """How far a log has come, 0 to 1."""

    number: int
    part: float


Order = Choose | Act | Upload | Download | ListLogs | FetchLog
ToProcess = Order | SendMessage
FromProcess = Ready | Alive | NotSent | Done | Refused | Progress

to_process: Codec[ToProcess] = Codec(ToProcess)
from_process: Codec[FromProcess] = Codec(FromProcess)
