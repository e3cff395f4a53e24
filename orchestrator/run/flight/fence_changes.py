"""An operator's change of fences in flight: read, proven, uploaded, taken over, answered."""

import asyncio
from collections import deque
from collections.abc import Callable, Mapping
from typing import get_args

from campaigns.setup.vehicle_fences import changed_fences
from orchestrator.run.vehicles.onboard_fences import OnboardFences
from safety.fence.geofence import Fence
from safety.guard.core.events import Cause, GuardEvent, is_about_fences
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
_ABOARD_AGAIN = "the autopilots have the old fence again"
_NOT_KNOWN = "it is not known yet whether the new fence applies or the old one"

Answer = Callable[[OperatorCommand, bool, str], None]
"""Takes a command, whether it was obeyed, and what was done or why not."""


class FenceChanges:
    """Changes fences in flight, one change at a time; old ones hold until all have new ones.

    The guard is asked first whether each vehicle could have its new fence. Then it is uploaded to
    the autopilots and read back; last the guard takes it, or it is put back to what it was. A
    landing, whoever wants it, ends a change. A guard that is silent when it is to take the fence
    may take it still: the operator is told that it is not known, and again when it is; until then
    the autopilots keep the new one. present: the fences of those that fly, at the start. changed:
    told of each change, and of who wanted it. answer: told of each command what came of it.
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
        self._due: deque[asyncio.Future[GuardEvent]] = deque()
        """What the guard was asked and has not answered, oldest first: it answers in order."""
        self._is_asked_to_take = False
        """Whether the guard may take a fence at any moment, or has done so unheard."""
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
        ours = is_about_fences(event) and bool(self._due)
        count = len(self._due) if event.kind == "guard" else int(ours)
        for _ in range(count):
            if not (due := self._due.popleft()).done():
                due.set_result(event)

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
            if self._is_asked_to_take:
                # It has taken the fence before it began to land, or answers that it does not.
                await asyncio.wait({change}, timeout=_GUARD_S)
            if change.done():
                self._answer(command, *change.result())
            elif self._is_asked_to_take:
                why = f"all vehicles are landing, and the guard has not answered; {_NOT_KNOWN}"
                self._answer(command, False, f"geofence: {why}")
            else:
                self._answer(command, False, f"geofence: all vehicles are landing; {_OLD_HOLDS}")
        finally:
            self._is_asked_to_take = False
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
        except BadInput as error:
            why = "; ".join(problem.headline for problem in error.problems)
            return False, f"geofence: {why}; {_OLD_HOLDS}"
        except VehicleError as error:
            left = await self._put_back()
            return False, f"geofence: {error}; {left or _OLD_HOLDS}"
        said, late = await self._taken(fences, command)
        if said.kind == "guard":
            left = await self._put_back()
            return False, f"geofence: {said.text}; {left or _ABOARD_AGAIN}"
        if said.kind != "geofence":
            return False, f"{late}{said.text}; {await self._put_back() or _OLD_HOLDS}"
        await self._aboard.confirm()
        self._present |= fences
        self._changed(fences, command.who)
        return True, f"{late}{said.text}"

    async def _taken(
        self, fences: Mapping[str, Fence], command: OperatorCommand
    ) -> tuple[GuardEvent, str]:
        """Have the guard take fences; return its reply, and in words whether it came late."""
        self._is_asked_to_take = True
        said = self._ask_guard(self._guard.change_fences, fences, command.who)
        late = ""
        done, _ = await asyncio.wait({said}, timeout=_GUARD_S)
        if not done:
            late = "late: "
            why = f"the guard has not answered in {_GUARD_S:g} s; {_NOT_KNOWN}"
            self._answer(command, False, f"geofence: {why}; a further answer will say")
        event = await said
        self._is_asked_to_take = False
        return event, late

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
            said = f"the autopilot did not confirm the fence within {ABOARD_S:g} s"
            raise VehicleError(said) from None

    async def _of_guard(
        self, ask: Callable[[Mapping[str, Fence], str], None], fences: Mapping[str, Fence], who: str
    ) -> GuardEvent:
        """Return the guard's reply about a fence. Raises VehicleError when silent."""
        try:
            async with asyncio.timeout(_GUARD_S):
                return await self._ask_guard(ask, fences, who)
        except TimeoutError:
            raise VehicleError("the guard did not answer") from None

    def _ask_guard(
        self, ask: Callable[[Mapping[str, Fence], str], None], fences: Mapping[str, Fence], who: str
    ) -> asyncio.Future[GuardEvent]:
        """Ask the guard about a fence; return its reply to come, also after one that is late."""
        said: asyncio.Future[GuardEvent] = asyncio.get_running_loop().create_future()
        self._due.append(said)
        ask(fences, who)
        return said

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
