"""The messages between a driver and its mavsdk process, in frames on a socket."""

from typing import Literal

from wil_campaign.foundation.processes.codec import MessageCodec, ProcessMessage
from wil_campaign.vehicles.driver.onboard.mission_protocol import ItemList, MissionItem
from wil_campaign.vehicles.driver.onboard.vehicle_logs import LogEntry

Action = Literal["hold", "land", "return_to_launch", "disarm", "terminate"]
"""Names of mavsdk's `Action`."""


class ChooseSystem(ProcessMessage, frozen=True):
    """Message to the mavsdk process: select the target system."""

    number: int
    system_id: int
    within_s: float


class SendMessage(ProcessMessage, frozen=True):
    """Message to the mavsdk process: send a message. fields: JSON. at_s: CLOCK_MONOTONIC."""

    name: str
    fields: str
    at_s: float


class CallAction(ProcessMessage, frozen=True):
    """Message to the mavsdk process: call a method of `Action`."""

    number: int
    action: Action


class UploadItems(ProcessMessage, frozen=True):
    """Message to the mavsdk process: upload a list of items by `MissionRaw`."""

    number: int
    which: ItemList
    items: tuple[MissionItem, ...]


class DownloadItems(ProcessMessage, frozen=True):
    """Message to the mavsdk process: download a list of items by `MissionRaw`."""

    number: int
    which: ItemList


class ListLogs(ProcessMessage, frozen=True):
    """Message to the mavsdk process: list the logs by `LogFiles`."""

    number: int


class FetchLog(ProcessMessage, frozen=True):
    """Message to the mavsdk process: fetch a log by `LogFiles` into a new file."""

    number: int
    entry: LogEntry
    path: str
    within_s: float


class MavsdkReady(ProcessMessage, frozen=True):
    """Message of the mavsdk process: mavsdk runs and listens."""


class MavsdkAlive(ProcessMessage, frozen=True):
    """Message of the mavsdk process: its thread runs. late: how many messages were too old."""

    late: int


class MessageNotSent(ProcessMessage, frozen=True):
    """Message of the mavsdk process: a message cannot be sent. result: of MavlinkDirect."""

    name: str
    result: str


class OrderExecuted(ProcessMessage, frozen=True):
    """Message of the mavsdk process: an order was executed; with the requested data."""

    number: int
    items: tuple[MissionItem, ...] = ()
    logs: tuple[LogEntry, ...] = ()


class OrderRefused(ProcessMessage, frozen=True):
    """Message of the mavsdk process: an order was refused. result: the name of mavsdk's result."""

    number: int
    result: str


class LogProgress(ProcessMessage, frozen=True):
    """Message of the mavsdk process: the part of a log that has arrived, 0 to 1."""

    number: int
    part: float


Order = ChooseSystem | CallAction | UploadItems | DownloadItems | ListLogs | FetchLog
ToProcess = Order | SendMessage
FromProcess = (
    MavsdkReady | MavsdkAlive | MessageNotSent | OrderExecuted | OrderRefused | LogProgress
)

to_process: MessageCodec[ToProcess] = MessageCodec(ToProcess)
from_process: MessageCodec[FromProcess] = MessageCodec(FromProcess)
