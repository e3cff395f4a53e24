"""The operator's hold in a run: its effect on the verdict, and how stages resume after it."""

import asyncio
from collections.abc import Awaitable, Callable

from wil_campaign.foundation.tasks import start_task, stop_tasks
from wil_campaign.orchestrator.state.run_state import FlightError, RunState
from wil_campaign.safety.guard.core.events import GuardEvent, brings_down
from wil_campaign.vehicles.errors import VehicleError

Do = Callable[[], Awaitable[object]]


class OperatorHold:
    """Follows the guard's reports of an operator's hold. count: holds so far.

    A hold after t0 makes the run INVALID and leaves the vehicles in the air: the operator decides
    what comes next. A stage that a hold interrupted is repeated after it.
    """

    def __init__(self, *, run_state: RunState) -> None:
        self._run_state = run_state
        self._free = asyncio.Event()
        self._free.set()
        self._changed = asyncio.Event()
        self.count = 0

    def receive(self, event: GuardEvent) -> None:
        """Process a guard event: a hold, or what ends it."""
        if event.kind == "hold":
            self._hold(event)
        elif event.kind == "resume" or brings_down(event):
            self._run_state.release()
            self._free.set()

    async def free(self) -> None:
        """Wait while the operator holds."""
        await self._free.wait()

    async def resumed(self, *, after: int) -> None:
        """Wait for the end of an operator's hold beyond the first `after`."""
        while self.count <= after:
            self._changed.clear()
            await self._changed.wait()
        await self._free.wait()

    async def through(self, do: Do, *, again: Do | None = None) -> None:
        """Run a stage, and repeat it until no operator's hold interrupted it.

        A resume cancels the interrupted stage, which is run again. again: the stage for such a
        repetition, where it may be half done; by default the same.
        """
        attempt = do
        while True:
            await self._free.wait()
            before = self.count
            try:
                await self._unless_resumed(attempt, after=before)
            except (VehicleError, FlightError):
                if self.count == before:
                    raise
            if self.count == before:
                return
            attempt = again or do

    async def _unless_resumed(self, do: Do, *, after: int) -> None:
        """Run a stage to its end, or until the operator resumes after a hold beyond `after`."""

        async def doing() -> None:
            await do()

        stage = start_task(doing(), name="stage")
        resumed = start_task(self.resumed(after=after), name="resumed")
        try:
            await asyncio.wait([stage, resumed], return_when=asyncio.FIRST_COMPLETED)
        finally:
            await stop_tasks(stage, resumed)

    def _hold(self, event: GuardEvent) -> None:
        self.count += 1
        self._changed.set()
        self._free.clear()
        self._run_state.hold()
        if self._run_state.reached("goal") and not self._run_state.reached("landed"):
            self._run_state.decide(
                "INVALID",
                f"{event.text} after the goal was given: the flight proves nothing",
                t_s=event.t_s,
                source="operator/hold",
                ends_flight=False,
            )
