"""Missions, fences and logs by mavsdk's plugins; parameters are ours, sent by MavlinkDirect."""

import asyncio
from collections.abc import Callable
from functools import partial
from pathlib import Path

from wil_campaign.plugins.mavsdk.mavsdk_client import MavsdkClient, MavsdkRefusedError
from wil_campaign.plugins.mavsdk.messages import DownloadItems, FetchLog, ListLogs, UploadItems
from wil_campaign.vehicles.driver.onboard.mission_protocol import (
    STATUSTEXT_WAIT_S,
    ItemList,
    MissionItem,
    MissionProtocol,
    UnsupportedListError,
    UnsureUploadError,
)
from wil_campaign.vehicles.driver.onboard.vehicle_logs import LogEntry, VehicleLogError, VehicleLogs
from wil_campaign.vehicles.driver.session.session import MavlinkSession

_LIST_S = 60.0
_LOGS_S, _LOG_S = 30.0, 1800.0
_PAUSES_S = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Pauses before each further listing: a busy machine gets time to answer."""


class MavsdkMissions(MissionProtocol):
    """Uploads and downloads mission lists by mavsdk's `MissionRaw`, and compares them.

    When mavsdk is gone it uses the session: uploaded lists still have to be restored. It clears
    lists by MISSION_CLEAR_ALL: `MissionRaw` clears missions only, and refuses an empty fence.
    """

    def __init__(
        self, *, client: MavsdkClient, session: MavlinkSession, circumstances: Callable[[], str]
    ) -> None:
        super().__init__(session=session, circumstances=circumstances)
        self._client = client

    async def _send_list(self, which: ItemList, items: list[MissionItem]) -> None:
        if self._client.failed:
            await super()._send_list(which, items)
            return
        make = partial(UploadItems, which=which, items=tuple(items))
        try:
            await self._client.order(make, f"{which.name.lower()} upload", _LIST_S)
        except MavsdkRefusedError as error:
            if error.result == "TIMEOUT":
                raise UnsureUploadError(str(error)) from error
            await asyncio.sleep(STATUSTEXT_WAIT_S)
            raise self._error(which, f"it was refused: mavsdk reports {error.result}") from error

    async def _read_list(self, which: ItemList) -> tuple[MissionItem, ...]:
        if self._client.failed:
            return await super()._read_list(which)
        make = partial(DownloadItems, which=which)
        try:
            reply = await self._client.order(make, f"{which.name.lower()} download", _LIST_S)
        except MavsdkRefusedError as error:
            failure = self._error(which, f"it was not read back: mavsdk reports {error.result}")
            if error.result == "UNSUPPORTED":
                raise UnsupportedListError(str(failure)) from error
            raise failure from error
        return reply.items


class MavsdkLogs(VehicleLogs):
    """Lists and fetches logs by mavsdk's `LogFiles`; by the session when mavsdk is gone."""

    def __init__(self, *, client: MavsdkClient, session: MavlinkSession) -> None:
        super().__init__(session=session)
        self._client = client

    async def _entries(self) -> tuple[LogEntry, ...]:
        if self._client.failed:
            return await super()._entries()
        pauses_s = iter(_PAUSES_S)
        while True:
            try:
                return (await self._client.order(ListLogs, "list of logs", _LOGS_S)).logs
            except MavsdkRefusedError as error:
                # mavsdk requests lost entries again, but not a list of which nothing arrived.
                pause_s = next(pauses_s, None)
                if error.result != "TIMEOUT" or pause_s is None:
                    raise VehicleLogError(str(error)) from error
                await asyncio.sleep(pause_s)

    async def _fetch_to(
        self, entry: LogEntry, half: Path, progress: Callable[[int], None] | None
    ) -> None:
        if self._client.failed:
            await super()._fetch_to(entry, half, progress)
            return

        def report(part: float) -> None:
            if progress is not None:
                progress(int(part * entry.size_bytes))

        # mavsdk does not overwrite a file.
        await asyncio.to_thread(half.unlink, missing_ok=True)
        make = partial(FetchLog, entry=entry, path=str(half), within_s=_LOG_S)
        try:
            await self._client.order(make, f"log {entry.number}", _LOG_S + 10.0, report)
        except MavsdkRefusedError as error:
            raise VehicleLogError(str(error)) from error
        size_bytes = (await asyncio.to_thread(half.stat)).st_size
        if size_bytes != entry.size_bytes:
            raise VehicleLogError(
                f"log {entry.number}: mavsdk received {size_bytes} of {entry.size_bytes} bytes"
            )
