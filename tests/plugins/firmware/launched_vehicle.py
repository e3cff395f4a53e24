"""A simulated autopilot that a test launches, without a guard between."""

import asyncio
import os
from collections.abc import Callable
from pathlib import Path
from typing import Self

from wil_campaign.foundation.processes.child import ChildProcess
from wil_campaign.plugins.firmware.launch_plan import PlannedLaunch
from wil_campaign.plugins.firmware.prepared_launch import PreparedLaunch
from wil_campaign.vehicles.launch import LaunchError
from wil_campaign.vehicles.links.link_strings import LinkAddress


class LaunchedVehicle:
    """Runs under a supervisor and ends with its context, or with us, however.

    on_end: called when it ends while it should run.
    """

    def __init__(
        self,
        *,
        launch: PlannedLaunch,
        folder: Path,
        system_id: int,
        ready_s: float = 30.0,
        grace_s: float = 3.0,
        locks: Path | None = None,
        on_end: Callable[[LaunchError], None] | None = None,
    ) -> None:
        self._take = {"launch": launch, "folder": folder, "system_id": system_id, "locks": locks}
        self._ready_s = ready_s
        self._grace_s = grace_s
        self._on_end = on_end
        self._prepared: PreparedLaunch | None = None
        self._child: ChildProcess | None = None
        self._running = False
        self.output = folder / "output.txt"

    @property
    def link(self) -> LinkAddress:
        assert self._prepared is not None
        return self._prepared.plan.link

    @property
    def pid(self) -> int | None:
        return None if self._child is None else self._child.pid

    async def __aenter__(self) -> Self:
        self._prepared = prepared = PreparedLaunch(**self._take)  # type: ignore[arg-type]
        try:
            self._child = child = ChildProcess(
                argv=prepared.command(parent=os.getpid(), grace_s=self._grace_s),
                environment={**os.environ, **prepared.plan.environment},
                grace_s=self._grace_s + 3.0,
            )
            child.start(self._take_end)
            prepared.note(child.pid or 0)
            end = asyncio.ensure_future(child.wait())
            try:
                await prepared.until_ready(end, ready_s=self._ready_s)
            finally:
                end.cancel()
        except BaseException:
            await self._end(prepared)
            raise
        self._running = True
        return self

    async def __aexit__(self, *raised: object) -> None:
        self._running = False
        if self._prepared is not None:
            await self._end(self._prepared)

    def _take_end(self, child: ChildProcess) -> None:
        if self._running and self._on_end is not None and self._prepared is not None:
            self._on_end(self._prepared.died(child.exit_code))

    async def _end(self, prepared: PreparedLaunch) -> None:
        if self._child is not None:
            await self._child.end()
        await prepared.clean_up()
        prepared.close()
