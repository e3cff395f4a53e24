"""A fence that an autopilot keeps for us: put aboard, exchanged in flight, and its own given back.

ArduCopter writes a list of items once its last one has come and checks it against the place at
once; PX4 keeps two lists and exchanges them when the new one is whole, and refuses one that leaves
its home out. In neither half a list ever counts, so either the old areas hold or the new ones.
"""

from collections.abc import Mapping
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Self

from vehicles.autopilots.autopilot import AutopilotName
from vehicles.driver.onboard.crash_safe_file import CrashSafeFile
from vehicles.driver.onboard.fence_backup import back_up_fence
from vehicles.driver.onboard.fence_protocol import (
    AutopilotFence,
    FenceProtocol,
    fence_items,
    fence_parameters,
)
from vehicles.driver.onboard.mission_protocol import MissionItem
from vehicles.driver.onboard.parameter_backup import ParameterBackup, ParameterValue
from vehicles.driver.onboard.parameters import Parameters
from vehicles.errors import VehicleError


class OnboardFence:
    """Uploads an onboard fence; an async context manager that restores the old one.

    A fence is put aboard by `offer`, and counts once it is confirmed; until then `put_back` has
    the autopilot keep what it kept before. journal: folder for what is to be put back after a crash
    (`Parameters.changed`, `note_fence`). Without entering it the fence stays for good.
    """

    def __init__(
        self,
        *,
        fences: FenceProtocol,
        parameters: Parameters,
        autopilot: AutopilotName,
        journal: Path | None = None,
    ) -> None:
        self._fences = fences
        self._parameters = parameters
        self._autopilot = autopilot
        self._journal = journal
        self._own: tuple[MissionItem, ...] | None = None
        self._notes: list[CrashSafeFile] = []
        self._stack = AsyncExitStack()
        self._offered: tuple[AutopilotFence, ParameterBackup] | None = None
        self.fence: AutopilotFence | None = None
        """What it was last confirmed to keep; None for what it had of its own."""

    @property
    def unsettled(self) -> bool:
        """Return whether an offered onboard fence is neither confirmed nor undone."""
        return self._offered is not None

    async def __aenter__(self) -> Self:
        """Do nothing yet: `keep` uploads the onboard fence."""
        return self

    async def __aexit__(self, *_: object) -> None:
        """Restore the autopilot's fence and parameters. Raises VehicleError."""
        if self._offered is not None:
            self._stack.push_async_exit(self._offered[1])
            self._offered = None
        await self._stack.aclose()

    async def keep(self, fence: AutopilotFence) -> None:
        """Upload an onboard fence, read it back, and confirm it. Raises VehicleError."""
        try:
            await self.offer(fence)
        except BaseException as error:
            try:
                await self.put_back()
            except VehicleError as second:
                error.add_note(str(second))
            raise
        await self.confirm()

    async def offer(
        self, fence: AutopilotFence, also: Mapping[str, ParameterValue] | None = None
    ) -> None:
        """Upload an onboard fence in place of the present one, and read it back.

        also: other parameters that go with it. Raises MissionError, ParameterError; then `put_back`
        is to be called, as it is when the offer is cancelled.
        """
        if self._own is None:
            self._own = await self._fences.items()
            self._stack.push_async_callback(self._restore_fence, self._own)
        present = {} if self.fence is None else fence_parameters(self._autopilot, self.fence)
        wanted = {**fence_parameters(self._autopilot, fence), **(also or {})}
        changes = {name: value for name, value in wanted.items() if present.get(name) != value}
        context = self._parameters.changed(changes, journal=self._journal)
        self._offered = (fence, context)
        if self._journal is not None:
            ours, vehicle = fence_items(fence.areas), self._parameters.vehicle
            self._notes.append(back_up_fence(self._journal, vehicle, own=self._own, ours=ours))
        await self._fences.upload(fence.areas)
        await context.__aenter__()

    async def confirm(self) -> None:
        """Confirm the offered fence: `put_back` restores this one from now on."""
        if self._offered is None:
            raise RuntimeError("no fence was sent")
        self.fence, context = self._offered
        self._offered = None
        self._stack.push_async_exit(context)

    async def put_back(self) -> None:
        """Restore the onboard fence before the offer, read back. Raises VehicleError.

        After an error it may be called again; without an offer there is nothing to do.
        """
        if self._offered is None:
            return
        await self._offered[1].__aexit__(None, None, None)
        if self.fence is not None:
            await self._fences.upload(self.fence.areas)
        elif self._own is not None:
            await self._fences.restore(self._own)
        self._offered = None

    async def _restore_fence(self, own: tuple[MissionItem, ...]) -> None:
        """Restore the autopilot's fence; on failure the backup stays for the next start."""
        try:
            await self._fences.restore(own)
            for note in self._notes:
                note.remove()
        finally:
            for note in self._notes:
                note.close()
