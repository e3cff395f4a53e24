"""An operator's geofence change in flight: validated, uploaded, applied by the guard, answered."""

import asyncio
from collections import deque
from collections.abc import Callable, Mapping
from typing import get_args

from wil_campaign.campaigns.setup.vehicle_fences import changed_fences
from wil_campaign.foundation.files.documents import BadInput
from wil_campaign.foundation.tasks import start_task, stop_tasks
from wil_campaign.orchestrator.run.vehicles.onboard_fences import OnboardFences
from wil_campaign.safety.fence.fence_files import parse_fence_file
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.guard.core.commands import NewFences
from wil_campaign.safety.guard.core.events import Cause, GuardEvent, is_about_fences
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.safety.guard.guard import Guard
from wil_campaign.vehicles.errors import VehicleError
from wil_campaign.worlds.geodesy import LocalFrame

_REPLY_TIMEOUT_S = 2.0
_UPLOAD_TIMEOUT_S = 30.0
"""How long an upload may take: 70 corners over a radio that loses a tenth."""
_RETRY_S = 1.0
_LANDING: frozenset[str] = frozenset(get_args(Cause))
_OLD_APPLIES = "the old fence applies"
_OLD_RESTORED = "the autopilots have the old fence again"
_NOT_KNOWN = "it is not known yet whether the new fence applies or the old one"

Answer = Callable[[OperatorCommand, bool, str], None]
"""Takes a command, whether it was obeyed, and what was done or why not."""


class FenceChanges:
    """Changes fences in flight, one change at a time; the old ones apply until all have new ones.

    The guard first checks whether each vehicle could have its new fence. Then the fence is uploaded
    to the autopilots and read back; last the guard applies it, or the autopilots get the old one
    back. Any landing ends a change. A guard that does not answer when it is to apply the fence may
    still do so: the operator is told that the outcome is not known, and again when it is; until
    then the autopilots keep the new fence. fences: of the flying vehicles at the start, by name.
    changed: called with each change and the operator's name. answer: called with the outcome of
    each command.
    """

    def __init__(
        self,
        *,
        guard: Guard,
        onboard_fences: OnboardFences,
        frame: LocalFrame,
        fences: dict[str, Fence],
        flying: tuple[str, ...],
        changed: Callable[[Mapping[str, Fence], str], None],
        answer: Answer,
    ) -> None:
        self._guard = guard
        self._onboard_fences = onboard_fences
        self._frame = frame
        self._fences: dict[str, Fence] = {
            name: fence for name, fence in fences.items() if name in flying
        }
        self._flying = flying
        self._changed = changed
        self._answer = answer
        self._requested: asyncio.Queue[OperatorCommand] = asyncio.Queue()
        self._awaited_replies: deque[asyncio.Future[GuardEvent]] = deque()
        """Replies that the guard owes, oldest request first: it answers in order."""
        self._may_take_fence = False
        """Whether the guard may apply a fence at any moment, or has applied it without a reply."""
        self._landing = asyncio.Event()
        self._idle = asyncio.Event()
        self._idle.set()
        self._ending = False

    def ask(self, command: OperatorCommand) -> None:
        """Queue an operator's fence change; refuse it while another one is in progress."""
        if not self._idle.is_set():
            why = "another change of the fence is in progress; try again when it is answered"
            self._answer(command, False, f"geofence: {why}")
            return
        self._idle.clear()
        self._requested.put_nowait(command)

    def receive(self, event: GuardEvent) -> None:
        """Process a guard event: its reply to a fence change, or the landing of all vehicles."""
        if event.kind in _LANDING:
            self._landing.set()
        is_reply = is_about_fences(event) and bool(self._awaited_replies)
        # The end of the guard process answers every request.
        count = len(self._awaited_replies) if event.kind == "guard" else int(is_reply)
        for _ in range(count):
            if not (reply := self._awaited_replies.popleft()).done():
                reply.set_result(event)

    async def run(self) -> None:
        """Carry out fence changes one after the other, until cancelled."""
        try:
            while True:
                await self._handle(await self._requested.get())
                self._idle.set()
        finally:
            self._idle.set()

    async def end(self) -> None:
        """End fence changes: the onboard configuration is about to be restored."""
        self._ending = True
        self._landing.set()
        await self._idle.wait()

    async def _handle(self, command: OperatorCommand) -> None:
        change = start_task(self._change(command), name="fence change")
        landing = start_task(self._landing.wait(), name="landing begun")
        try:
            await asyncio.wait({change, landing}, return_when=asyncio.FIRST_COMPLETED)
            if self._may_take_fence:
                # The guard applied the fence before the landing began, or replies that it does not.
                await asyncio.wait({change}, timeout=_REPLY_TIMEOUT_S)
            if change.done():
                self._answer(command, *change.result())
            elif self._may_take_fence:
                why = f"all vehicles are landing, and the guard has not answered; {_NOT_KNOWN}"
                self._answer(command, False, f"geofence: {why}")
            else:
                self._answer(command, False, f"geofence: all vehicles are landing; {_OLD_APPLIES}")
        finally:
            self._may_take_fence = False
            await stop_tasks(change, landing)
        while self._onboard_fences.unsettled and not self._ending:
            if await self._restore_old():
                await asyncio.sleep(_RETRY_S)

    async def _change(self, command: OperatorCommand) -> tuple[bool, str]:
        """Return whether the fence change was made, and the guard's text or the reason why not."""
        try:
            fences = self._read_fences(command)
            reply = await self._propose(fences, command.who)
            if reply.kind != "proposed":
                return False, f"{reply.text}; {_OLD_APPLIES}"
            await self._upload(fences)
        except BadInput as error:
            why = "; ".join(problem.headline for problem in error.problems)
            return False, f"{why}; {_OLD_APPLIES}"
        except VehicleError as error:
            left = await self._restore_old()
            return False, f"geofence: {error}; {left or _OLD_APPLIES}"
        reply, late = await self._apply_in_guard(fences, command)
        if reply.kind == "guard":
            left = await self._restore_old()
            return False, f"geofence: {reply.text}; {left or _OLD_RESTORED}"
        if reply.kind != "geofence":
            return False, f"{late}{reply.text}; {await self._restore_old() or _OLD_APPLIES}"
        await self._onboard_fences.confirm()
        self._fences |= fences
        self._changed(fences, command.who)
        return True, f"{late}{reply.text}"

    async def _apply_in_guard(
        self, fences: Mapping[str, Fence], command: OperatorCommand
    ) -> tuple[GuardEvent, str]:
        """Have the guard apply fences; return its reply, and "late: " where it came late."""
        self._may_take_fence = True
        reply = self._request_guard(NewFences(command.who, dict(fences)))
        late = ""
        done, _ = await asyncio.wait({reply}, timeout=_REPLY_TIMEOUT_S)
        if not done:
            late = "late: "
            why = f"the guard has not answered in {_REPLY_TIMEOUT_S:g} s; {_NOT_KNOWN}"
            self._answer(command, False, f"geofence: {why}; a second answer will follow")
        event = await reply
        self._may_take_fence = False
        return event, late

    def _read_fences(self, command: OperatorCommand) -> Mapping[str, Fence]:
        """Return the new fences of flying vehicles. Raises BadInput, VehicleError."""
        document = parse_fence_file(command.document.encode(), name="geofence")
        fences = changed_fences(document, self._frame, self._fences)
        mine: dict[str, Fence] = {
            name: fence for name, fence in fences.items() if name in self._flying
        }
        if not mine:
            raise VehicleError(f"{' and '.join(fences)} is not in flight here")
        return mine

    async def _upload(self, fences: Mapping[str, Fence]) -> None:
        try:
            async with asyncio.timeout(_UPLOAD_TIMEOUT_S):
                await self._onboard_fences.offer(fences)
        except TimeoutError:
            reason = f"the autopilot did not confirm the fence within {_UPLOAD_TIMEOUT_S:g} s"
            raise VehicleError(reason) from None

    async def _propose(self, fences: Mapping[str, Fence], who: str) -> GuardEvent:
        """Return the guard's reply to proposed fences. Raises VehicleError without a reply."""
        try:
            async with asyncio.timeout(_REPLY_TIMEOUT_S):
                return await self._request_guard(NewFences(who, dict(fences), proposed=True))
        except TimeoutError:
            raise VehicleError("the guard did not answer") from None

    def _request_guard(self, request: NewFences) -> asyncio.Future[GuardEvent]:
        """Send the guard a request about fences; return the future of its reply."""
        reply: asyncio.Future[GuardEvent] = asyncio.get_running_loop().create_future()
        self._awaited_replies.append(reply)
        self._guard.send(request)
        return reply

    async def _restore_old(self) -> str:
        """Restore the autopilots' old fences; return in words which may still have the new ones."""
        try:
            await self._onboard_fences.restore()
        except VehicleError as error:
            names = " and ".join(self._onboard_fences.unsettled)
            return (
                f"the guard applies the old fence; the autopilot of {names} may still have "
                f"the new one: {error}"
            )
        return ""
