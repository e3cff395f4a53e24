"""An operator's change of fences in flight: read, given to the guard, judged by, answered."""

import asyncio
from collections.abc import Callable

from campaigns.fences import changed_fences
from orchestrator.operator import OperatorCommand
from orchestrator.run.guarding import Guard
from safety.geofence import Fence
from safety.guard.events import GuardEvent
from worlds.documents import BadInput, parse
from worlds.geodesy import LocalFrame

_ANSWER_S = 2.0

Answer = Callable[[OperatorCommand, bool, str], None]
"""Takes a command, whether it was obeyed, and what was done or why not."""


class Fencing:
    """Changes fences; those that hold go on holding until the guard has taken the new ones.

    present: the fences of those that fly, at the start. changed: told of each vehicle's new fence.
    answer: told once for each command.
    """

    def __init__(
        self,
        *,
        guard: Guard,
        frame: LocalFrame,
        present: dict[str, Fence],
        flying: tuple[str, ...],
        changed: Callable[[str, Fence], None],
        answer: Answer,
    ) -> None:
        self._guard = guard
        self._frame = frame
        self._present: dict[str, Fence] = {
            name: fence for name, fence in present.items() if name in flying
        }
        self._flying = flying
        self._changed = changed
        self._answer = answer
        self._asked: asyncio.Queue[OperatorCommand] = asyncio.Queue()
        self._said: asyncio.Future[GuardEvent] | None = None

    def ask(self, command: OperatorCommand) -> None:
        """Take a command; its answer comes later."""
        self._asked.put_nowait(command)

    def take(self, event: GuardEvent) -> None:
        """Take what the guard says: it may be the answer that is waited for."""
        ours = event.kind in {"geofence", "refused"} and "geofence" in f"{event.kind} {event.text}"
        if ours and self._said is not None and not self._said.done():
            self._said.set_result(event)

    async def run(self) -> None:
        """Do what is asked, one after the other, until cancelled."""
        while True:
            command = await self._asked.get()
            try:
                done = await self._change(command)
            except (BadInput, TimeoutError) as error:
                self._answer(command, False, _why(error))
                continue
            self._answer(command, done.kind == "geofence", done.text)

    async def _change(self, command: OperatorCommand) -> GuardEvent:
        """Return what the guard says to it. Raises BadInput, TimeoutError."""
        document = parse(command.document.encode(), name="geofence")
        fences = changed_fences(document, self._frame, self._present)
        mine: dict[str, Fence] = {name: one for name, one in fences.items() if name in self._flying}
        self._said = asyncio.get_running_loop().create_future()
        self._guard.change_fences(mine, command.who)
        async with asyncio.timeout(_ANSWER_S):
            said = await self._said
        if said.kind == "geofence":
            self._present |= mine
            for name, fence in mine.items():
                self._changed(name, fence)
        return said


def _why(error: BadInput | TimeoutError) -> str:
    if isinstance(error, BadInput):
        return "; ".join(problem.headline for problem in error.problems)
    return "the guard did not answer; the fences that held hold"
