"""A fence that the autopilot enforces: uploaded, replaced in flight, and the original restored.

ArduCopter stores a list of items once the last one has arrived and checks it against the position
at once; PX4 keeps two lists, swaps them when the new one is complete, and refuses one that excludes
home. Neither ever enforces half a list: either the old areas apply or the new ones.
"""

from collections.abc import Mapping
from contextlib import AsyncExitStack
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Self

from wil_campaign.foundation.tasks import finish_in_task
from wil_campaign.vehicles.driver.onboard.crash_safe_file import CrashSafeFile
from wil_campaign.vehicles.driver.onboard.disk_access import access_disk, remove_backup
from wil_campaign.vehicles.driver.onboard.fence_backup import back_up_fence, fence_backup_error
from wil_campaign.vehicles.driver.onboard.fence_protocol import (
    AutopilotFence,
    FenceProtocol,
    fence_items,
)
from wil_campaign.vehicles.driver.onboard.mission_protocol import MissionError, MissionItem
from wil_campaign.vehicles.driver.onboard.parameter_backup import ParameterBackup, ParameterValue
from wil_campaign.vehicles.driver.onboard.parameters import OnboardParameters
from wil_campaign.vehicles.errors import VehicleError


class OnboardFence:
    """Uploads an onboard fence; an async context manager that restores the old one.

    `offer` uploads a fence, which is final once it is confirmed; until then `put_back` restores the
    previous one. backup_folder: for backups to restore after a crash (`OnboardParameters.changed`,
    `back_up_fence`). Without entering the context manager the fence stays for good.
    """

    def __init__(
        self,
        *,
        fences: FenceProtocol,
        parameters: OnboardParameters,
        autopilot: str,
        backup_folder: Path | None = None,
    ) -> None:
        self._fences = fences
        self._parameters = parameters
        self._autopilot = autopilot
        self._backup_folder = backup_folder
        self._original_items: tuple[MissionItem, ...] | None = None
        self._fence_backups: list[CrashSafeFile] = []
        self._changed: list[ParameterBackup] = []
        self._stack = AsyncExitStack()
        self._offered: tuple[AutopilotFence, ParameterBackup] | None = None
        self.fence: AutopilotFence | None = None
        """The last confirmed fence; None for the vehicle's original one."""

    @property
    def unsettled(self) -> bool:
        """Return whether an offered onboard fence is neither confirmed nor undone."""
        return self._offered is not None

    async def __aenter__(self) -> Self:
        """Do nothing: `keep` or `offer` uploads the onboard fence."""
        return self

    async def __aexit__(self, *_: object) -> None:
        """Restore the autopilot's fence and parameters. Raises VehicleError."""
        if self._offered is not None:
            self._stack.push_async_exit(self._offered[1])
            self._offered = None
        await self._stack.aclose()

    def leave(self) -> bool:
        """Leave fence and parameters changed, for `restore_fence` and `restore_backups`.

        Returns whether there is anything to be restored.
        """
        offered = () if self._offered is None else (self._offered[1],)
        for change in (*self._changed, *offered):
            change.leave()
        for backup in self._fence_backups:
            backup.close()
        self._offered = None
        self._stack.pop_all()
        return self._original_items is not None

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

        also: other parameters to set with it. Raises MissionError, ParameterError; then, and when
        the offer is cancelled, the caller calls `put_back`.
        """
        if self._original_items is None:
            self._original_items = await self._fences.items()
            self._stack.push_async_exit(partial(self._restore_fence, self._original_items))
        present = {} if self.fence is None else self.fence.parameters(self._autopilot)
        wanted = {**fence.parameters(self._autopilot), **(also or {})}
        changes = {name: value for name, value in wanted.items() if present.get(name) != value}
        context = self._parameters.changed(changes, backup_folder=self._backup_folder)
        self._offered = (fence, context)
        if self._backup_folder is not None:
            backing_up = self._back_up(
                self._backup_folder, own=self._original_items, ours=fence_items(fence.areas)
            )
            await finish_in_task(backing_up, name="fence backup")
        await self._fences.upload(fence.areas)
        await context.__aenter__()

    async def confirm(self) -> None:
        """Confirm the offered fence: `put_back` restores this one from now on."""
        if self._offered is None:
            raise RuntimeError("no fence is offered")
        self.fence, context = self._offered
        self._offered = None
        self._changed.append(context)
        self._stack.push_async_exit(context)

    async def put_back(self) -> None:
        """Restore the fence from before the offer, and read it back. Raises VehicleError.

        The fence is restored also where the parameters are not. After an error it may be called
        again, unless only a backup file is left; without an offer it does nothing.
        """
        if self._offered is None:
            return
        failure: VehicleError | None = None
        try:
            await self._offered[1].__aexit__(None, None, None)
        except VehicleError as error:
            failure = error
        if self.fence is not None:
            await self._fences.upload(self.fence.areas)
        elif self._original_items is not None:
            await self._fences.restore(self._original_items)
        if not self._offered[1].changes:
            self._offered = None
        if failure is not None:
            raise failure

    async def _back_up(
        self, folder: Path, *, own: tuple[MissionItem, ...], ours: tuple[MissionItem, ...]
    ) -> None:
        """Back up the autopilot's fence; a thread writes, as the disk may stand still.

        To be finished whatever happens to the offer: a backup is released only if it is known.
        """
        write = partial(back_up_fence, folder, self._parameters.vehicle, own=own, ours=ours)
        try:
            backup = await access_disk(write, name="fence backup", late=CrashSafeFile.discard)
        except OSError as error:
            raise fence_backup_error(folder, error) from error
        self._fence_backups.append(backup)

    async def _restore_fence(
        self,
        own: tuple[MissionItem, ...],
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Restore the autopilot's fence; on failure the backup stays for the next start.

        error: of a parameter that was to be restored before, which gets a failure as a note.
        """
        del kind, trace
        try:
            await self._restore_items(own)
        except VehicleError as second:
            if error is None:
                raise
            error.add_note(str(second))

    async def _restore_items(self, own: tuple[MissionItem, ...]) -> None:
        try:
            await self._fences.restore(own)
            for backup in self._fence_backups:
                if left := await remove_backup(backup.path, backup.remove, name="fence backup"):
                    raise MissionError(f"the vehicle's fence is restored, but its {left}")
        finally:
            for backup in self._fence_backups:
                backup.close()
