"""An operator's change of fences in flight: read, proven, uploaded, taken over, answered."""

import asyncio
from collections.abc import Callable, Mapping
from typing import get_args

from campaigns.setup.vehicle_fences import changed_fences
from orchestrator.run.vehicles.onboard_fences import OnboardFences
from safety.fence.geofence import Fence
from safety.guard.core.events import Cause, GuardEvent
from safety.guard.core.operator_command import OperatorCommand
from safety.guard.guard import Guard
from vehicles.errors import VehicleError
from vehicles.tasks import start, stop
from worlds.files.documents import BadInput, parse
from worlds.geodesy import LocalFrame

_GUARD_S = 2.0
ABOARD_S = 30.0
"""How long an upload may take: 70 corners over a radio that loses a tenth."""
_AGAIN_S = 1.0
_LANDING: frozenset[str] = frozenset(get_args(Cause))
_OLD_HOLDS = "the old fence applies"

Answer = Callable[[OperatorCommand, bool, str], None]
"""Takes a command, whether it was obeyed, and what was done or why not."""


class FenceChanges:
    """Changes fences in flight, one change at a time; old ones hold until all have new ones.

    The guard is asked first whether each vehicle could have its new fence. Then it is uploaded to
    the autopilots and read back; last the guard takes it, or it is put back to what it was. A
    landing, whoever wants it, ends a change. present: the fences of those that fly, at the start.
    changed: told of each change, and of who wanted it. answer: told once for each command.
    """

    def __init__(
        self,
        *,
        guard: Guard,
        aboard: OnboardFences,
        frame: LocalFrame,
        present: dict[str, Fence],
        flying: tuple[str, ...],
        changed: Callable[[Mapping[str, Fence], str], None],
        answer: Answer,
    ) -> None:
        self._guard = guard
        self._aboard = aboard
        self._frame = frame
        self._present: dict[str, Fence] = {
            name: fence for name, fence in present.items() if name in flying
        }
        self._flying = flying
        self._changed = changed
        self._answer = answer
        self._asked: asyncio.Queue[OperatorCommand] = asyncio.Queue()
        self._said: asyncio.Future[GuardEvent] | None = None
        self._landing = asyncio.Event()
        self._idle = asyncio.Event()
        self._idle.set()
        self._ending = False

    def ask(self, command: OperatorCommand) -> None:
        """Take an operator's fence change; its reply comes later, unless one is under way."""
        if not self._idle.is_set():
            why = "another change of the fence is in progress; try again when it is answered"
            self._answer(command, False, f"geofence: {why}")
            return
        self._idle.clear()
        self._asked.put_nowait(command)

    def take(self, event: GuardEvent) -> None:
        """Take a guard event: its reply to a fence change, or that all are landing."""
        if event.kind in _LANDING:
            self._landing.set()
        ours = event.kind in {"proposed", "geofence"} or (
            event.kind == "refused" and "geofence" in event.text
        )
        if ours and self._said is not None and not self._said.done():
            self._said.set_result(event)

    async def run(self) -> None:
        """Carry out fence changes, one after the other, until cancelled."""
        try:
            while True:
                await self._obey(await self._asked.get())
                self._idle.set()
        finally:
            self._idle.set()

    async def end(self) -> None:
        """End fence changes: the onboard configuration is about to be restored."""
        self._ending = True
        self._landing.set()
        await self._idle.wait()

    async def _obey(self, command: OperatorCommand) -> None:
        change = start(self._change(command), name="fence change")
        landing = start(self._landing.wait(), name="landing begun")
        try:
            await asyncio.wait({change, landing}, return_when=asyncio.FIRST_COMPLETED)
            if change.done():
                self._answer(command, *change.result())
            else:
                self._answer(command, False, f"geofence: all vehicles are landing; {_OLD_HOLDS}")
        finally:
            await stop(change, landing)
        while self._aboard.unsettled and not self._ending:
            if await self._put_back():
                await asyncio.sleep(_AGAIN_S)

    async def _change(self, command: OperatorCommand) -> tuple[bool, str]:
        """Return whether the fence change was made, and the guard's words or why not."""
        try:
            fences = self._read_fences(command)
            said = await self._of_guard(self._guard.propose_fences, fences, command.who)
            if said.kind != "proposed":
                return False, f"{said.text}; {_OLD_HOLDS}"
            await self._upload(fences)
            said = await self._of_guard(self._guard.change_fences, fences, command.who)
        except BadInput as error:
            why = "; ".join(problem.headline for problem in error.problems)
            return False, f"geofence: {why}; {_OLD_HOLDS}"
        except VehicleError as error:
            left = await self._put_back()
            return False, f"geofence: {error}; {left or _OLD_HOLDS}"
        if said.kind != "geofence":
            return False, f"{said.text}; {await self._put_back() or _OLD_HOLDS}"
        await self._aboard.confirm()
        self._present |= fences
        self._changed(fences, command.who)
        return True, said.text

    def _read_fences(self, command: OperatorCommand) -> Mapping[str, Fence]:
        """Return the new fences of flying vehicles. Raises BadInput, VehicleError."""
        document = parse(command.document.encode(), name="geofence")
        fences = changed_fences(document, self._frame, self._present)
        mine: dict[str, Fence] = {name: one for name, one in fences.items() if name in self._flying}
        if not mine:
            raise VehicleError(f"{' and '.join(fences)} is not in flight here")
        return mine

    async def _upload(self, fences: Mapping[str, Fence]) -> None:
        try:
            async with asyncio.timeout(ABOARD_S):
                await self._aboard.offer(fences)
        except TimeoutError:
            raise VehicleError(f"not aboard within {ABOARD_S:g} s") from None

    async def _of_guard(
        self, ask: Callable[[Mapping[str, Fence], str], None], fences: Mapping[str, Fence], who: str
    ) -> GuardEvent:
        """Return the guard's reply to a fence change. Raises VehicleError when silent."""
        self._said = asyncio.get_running_loop().create_future()
        ask(fences, who)
        try:
            async with asyncio.timeout(_GUARD_S):
                return await self._said
        except TimeoutError:
            raise VehicleError("the guard did not answer") from None

    async def _put_back(self) -> str:
        """Restore the autopilots' old fences; return in words which may not have them."""
        try:
            await self._aboard.put_back()
        except VehicleError as error:
            names = " and ".join(self._aboard.unsettled)
            return (
                f"the guard applies the old one; the autopilot of {names} may still have "
                f"the new one: {error}"
            )
        return ""
