"""Calls the mavsdk library, one instance for one vehicle; its calls block, so they need threads.

The plugins in use, and why the others are not: docs/decisions/0012-mavsdk.md.
"""

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from enum import IntEnum
from typing import Any

from mavsdk import ComponentType, Configuration, Mavsdk, System
from mavsdk.plugins.action import Action, ActionError
from mavsdk.plugins.log_files import Entry, LogFiles, LogFilesError, LogFilesResult
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkDirectError, MavlinkMessage
from mavsdk.plugins.mission_raw import MissionItem as RawItem
from mavsdk.plugins.mission_raw import MissionRaw, MissionRawError

from wil_campaign.plugins.mavsdk.ids import OWN_COMPONENT, OWN_SYSTEM
from wil_campaign.plugins.mavsdk.messages import (
    CallAction,
    ChooseSystem,
    DownloadItems,
    FetchLog,
    ListLogs,
    Order,
    UploadItems,
)
from wil_campaign.vehicles.driver.onboard.mission_protocol import ItemList, MissionItem
from wil_campaign.vehicles.driver.onboard.vehicle_logs import LogEntry

_POLL_S = 0.02

Progress = Callable[[float], None]


class MavsdkLibraryError(Exception):
    """The mavsdk library refused an order or message; the message is the name of its result."""


@dataclass(frozen=True, slots=True)
class MavsdkOutcome:
    """The outcome of an order to the mavsdk library."""

    items: tuple[MissionItem, ...] = ()
    logs: tuple[LogEntry, ...] = ()


class MavsdkLibrary:
    """The mavsdk library on one connection. Raises LibraryError, also in its methods."""

    def __init__(self, url: str) -> None:
        kind = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
        self._mavsdk = Mavsdk(kind)
        result = self._mavsdk.add_any_connection(url)
        if result != 0:
            raise MavsdkLibraryError(f"mavsdk cannot connect to {url}: {_name(result)}")
        self._system: System | None = None
        self._target = 0
        self._acting = threading.Lock()
        self._action: Action | None = None
        # mavsdk refuses a second transfer, even when the caller no longer waits for the first.
        self._transfers = {"missions": threading.Lock(), "logs": threading.Lock()}

    def send_message(self, name: str, fields: str) -> None:
        """Send a message by mavsdk; fields as JSON. Does nothing before a system is chosen."""
        if self._system is None:
            return
        message = MavlinkMessage(name, OWN_SYSTEM, OWN_COMPONENT, self._target, 1, fields)
        try:
            self._direct.send_message(message)
        except MavlinkDirectError as error:
            raise MavsdkLibraryError(error.result.name) from error

    def execute(self, order: Order, progress: Progress) -> MavsdkOutcome:
        """Execute an order by the mavsdk library."""
        if isinstance(order, ChooseSystem):
            self._choose(order)
            return MavsdkOutcome()
        if self._system is None:
            raise MavsdkLibraryError("NO_SYSTEM")
        try:
            return self._execute(self._system, order, progress)
        except (ActionError, MissionRawError, LogFilesError) as error:
            raise MavsdkLibraryError(error.result.name) from error

    def _choose(self, order: ChooseSystem) -> None:
        end_s = time.monotonic() + order.within_s
        while True:
            for system in self._mavsdk.get_systems():
                if system.get_system_id() == order.system_id and system.has_autopilot():
                    self._receive(system)
                    return
            if time.monotonic() > end_s:
                raise MavsdkLibraryError("TIMEOUT")
            time.sleep(_POLL_S)

    def _receive(self, system: System) -> None:
        self._direct = MavlinkDirect(system)
        self._missions = MissionRaw(system)
        self._logs = LogFiles(system)
        self._target = system.get_system_id()
        self._system = system

    def _execute(
        self,
        system: System,
        order: CallAction | UploadItems | DownloadItems | ListLogs | FetchLog,
        progress: Progress,
    ) -> MavsdkOutcome:
        match order:
            case CallAction():
                getattr(self._actions(system), order.action)()
                return MavsdkOutcome()
            case UploadItems():
                with self._transfers["missions"]:
                    self._upload(order)
                return MavsdkOutcome()
            case DownloadItems():
                with self._transfers["missions"]:
                    return MavsdkOutcome(
                        items=tuple(map(MissionItem.of, self._download(order.which)))
                    )
            case ListLogs():
                with self._transfers["logs"]:
                    return MavsdkOutcome(logs=self._list())
            case FetchLog():
                with self._transfers["logs"]:
                    self._fetch(order, progress)
                return MavsdkOutcome()

    def _actions(self, system: System) -> Action:
        """Return mavsdk's Action, created at its first use.

        Once created, and after each gap of the link, it requests EXTENDED_SYS_STATE once a second,
        which replaces the driver's rate.
        """
        with self._acting:
            if self._action is None:
                self._action = Action(system)
            return self._action

    def _upload(self, order: UploadItems) -> None:
        items = [_raw(number, item, order.which) for number, item in enumerate(order.items)]
        match order.which:
            case ItemList.MISSION:
                self._missions.upload_mission(items)
            case ItemList.FENCE:
                self._missions.upload_geofence(items)
            case ItemList.RALLY:
                self._missions.upload_rally_points(items)

    def _download(self, which: ItemList) -> Sequence[Any]:
        match which:
            case ItemList.MISSION:
                items = self._missions.download_mission()
            case ItemList.FENCE:
                items = self._missions.download_geofence()
            case ItemList.RALLY:
                items = self._missions.download_rallypoints()
        return list(items)

    def _list(self) -> tuple[LogEntry, ...]:
        try:
            entries = self._logs.get_entries()
        except LogFilesError as error:
            if error.result is LogFilesResult.NO_LOGFILES:
                return ()
            raise
        return tuple(LogEntry(entry.id, entry.size_bytes, _utc_s(entry.date)) for entry in entries)

    def _fetch(self, order: FetchLog, progress: Progress) -> None:
        ended = threading.Event()
        results: list[LogFilesResult] = []

        def report(result: LogFilesResult, data: Any, _: object) -> None:
            if result is LogFilesResult.NEXT:
                progress(data.progress)
                return
            results.append(result)
            ended.set()

        entry = Entry(order.entry.number, "", order.entry.size_bytes)
        self._logs.download_log_file_async(entry, order.path, report)
        if not ended.wait(order.within_s):
            raise MavsdkLibraryError("TIMEOUT")
        if results[0] is not LogFilesResult.SUCCESS:
            raise MavsdkLibraryError(results[0].name)


def _raw(number: int, item: MissionItem, which: ItemList) -> RawItem:
    first, second, third, fourth = item.params
    return RawItem(
        seq=number,
        frame=item.frame,
        command=item.command,
        # mavsdk refuses a mission whose first item is not the current one (CURRENT_INVALID).
        current=int(which is ItemList.MISSION and number == 0),
        autocontinue=int(item.autocontinue),
        param1=first,
        param2=second,
        param3=third,
        param4=fourth,
        x=item.x,
        y=item.y,
        z=item.z,
        mission_type=int(which),
    )


def _utc_s(date: str) -> int | None:
    """Return a mavsdk log's start; None when the vehicle did not know the time (the epoch)."""
    try:
        return int(datetime.fromisoformat(date).timestamp()) or None
    except ValueError:
        return None


def _name(result: object) -> str:
    return result.name if isinstance(result, IntEnum) else str(result)
