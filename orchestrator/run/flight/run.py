"""Fly one run: from starting the pair to its result."""

import asyncio
import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from typing import Any

from wil_campaign.foundation.clocks.virtual_loop import run_on_clock
from wil_campaign.foundation.tasks import FAULTS, TakeFault, TaskAccount, is_task_cancellation
from wil_campaign.orchestrator.operator.run_messages import OperatorInbox, Report
from wil_campaign.orchestrator.run.flight.conduct import EXPECTED, conduct_flight
from wil_campaign.orchestrator.run.flight.run_parts import GroundParts, flight_parts, ground_parts
from wil_campaign.orchestrator.run.judging.run_outcome import (
    broken_result,
    external_result,
    run_result_of,
)
from wil_campaign.orchestrator.run.perception.autonomy_calls import AutonomyFault
from wil_campaign.orchestrator.run.perception.autonomy_runner import AutonomyRunner
from wil_campaign.orchestrator.run.perception.runner_factory import open_runners
from wil_campaign.orchestrator.run.perception.stray_errors import decide_stray
from wil_campaign.orchestrator.run.perception.warm_up import warm_up
from wil_campaign.orchestrator.run.vehicles.firmware_record import flown_firmware
from wil_campaign.orchestrator.run.vehicles.pair import VehiclePair, open_pair
from wil_campaign.orchestrator.run_results.run_result import (
    RunResult,
    SlowAutonomy,
    TopicMessageLoss,
)
from wil_campaign.orchestrator.state.faults import fault_log
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.recipes.working import StepError
from wil_campaign.vehicles.errors import VehicleError
from wil_campaign.vehicles.links.link import LinkError

Disturb = Callable[[VehiclePair, RunState], None]
"""Called with the pair once it is open; injects faults at its own times: kill, mute, break."""


def fly_one_run(
    setup: RunSetup, report: Report, inbox: OperatorInbox, *, disturb: Disturb | None = None
) -> RunResult:
    """Fly one run on its clock and return its result; its recordings are then in its folder.

    disturb: for runs that test the reaction to a fault.
    """
    warm_up(setup)
    flown = FlownRun(setup)
    try:
        run_on_clock(setup.clock, flown.fly(report, inbox, disturb))
    except FAULTS as error:
        if flown.run_state is None:
            raise
        flown.run_state.fault(error, "the run's loop")
    finally:
        flown.close_streams()
    return flown.result()


class FlownRun:
    """One run from its start to its result, also when an internal exception ends it."""

    def __init__(self, setup: RunSetup) -> None:
        self._setup = setup
        self._started_s = time.monotonic()
        self._ground: GroundParts | None = None
        self._streams = ExitStack()
        self._end_s = 0.0
        self.run_state: RunState | None = None

    async def fly(self, report: Report, inbox: OperatorInbox, disturb: Disturb | None) -> None:
        """Fly the run; exceptions, and tasks that do not end when cancelled, decide the run."""
        setup, loop = self._setup, asyncio.get_running_loop()
        run_state = RunState(time=loop.time, log_fault=fault_log(setup.order.folder / "log.jsonl"))
        self.run_state = run_state
        decide = partial(decide_stray, run_state, setup.subject)
        loop.set_exception_handler(partial(_report_unhandled, run_state, decide))
        account = TaskAccount(fault=decide, expected=EXPECTED)
        with account.of(loop), run_state.recording_faults("the run"):
            await self._fly(run_state, report, inbox, disturb)
        self._end_s = loop.time()

    async def _fly(
        self, run_state: RunState, report: Report, inbox: OperatorInbox, disturb: Disturb | None
    ) -> None:
        """Open the run's streams and fly its vehicles."""
        setup = self._setup
        with self._streams as streams:
            ground = self._ground = ground_parts(setup, run_state, report, streams)
            try:
                await _fly_pair(ground, inbox, disturb)
            except AutonomyFault as fault:
                run_state.decide(fault.kind, str(fault), source="autonomy", trace=fault.trace)
            except (VehicleError, LinkError, StepError) as error:
                run_state.decide("ERROR", str(error))
            except FAULTS as error:
                if is_task_cancellation(error):
                    raise
                # Recorded here, while the recordings are still open.
                run_state.fault(error, "the run")
            run_state.enter("end")

    def close_streams(self) -> None:
        """Close what the run could not, where its loop broke off, as by a second interrupt.

        Else their threads would stay in this process, and the end of their files unwritten.
        """
        self._streams.close()

    def result(self) -> RunResult:
        """Return the run's result, after its event loop has closed."""
        run_state, ground = self.run_state, self._ground
        if run_state is None:
            raise RuntimeError("the run has not been flown: call fly() first")
        wall_s = time.monotonic() - self._started_s
        end_s = run_state.entered_s.get("end", self._end_s)
        if ground is not None:
            with run_state.recording_faults("the result"):
                return run_result_of(
                    setup=self._setup,
                    run_state=run_state,
                    judge=ground.judge,
                    sync=ground.sync.result(),
                    mixings=() if ground.perception is None else ground.perception.mixings,
                    collisions=tuple(ground.recorder.collisions),
                    outside=external_result(ground.external_io, ground.perception),
                    artifacts=ground.recorder.artifacts,
                    preflight=ground.preflight.items,
                    before_arming=ground.arming.steps,
                    fence_changes=tuple(ground.oracle_runner.fence_changes),
                    twin=None if ground.twin is None else ground.twin.result(),
                    losses=tuple(
                        TopicMessageLoss(loss.topic, loss.offered, loss.lost)
                        for loss in ground.recorder.losses
                    ),
                    actors=tuple(actor.result() for actor in ground.actors),
                    slow=_slow_autonomies(ground),
                    views_ended=ground.feeds.ended,
                    firmware=flown_firmware(ground.contexts, self._setup),
                    events=ground.events,
                    end_s=end_s,
                    wall_s=wall_s,
                )
        return broken_result(self._setup, run_state, end_s=end_s, wall_s=wall_s)


async def _fly_pair(ground: GroundParts, inbox: OperatorInbox, disturb: Disturb | None) -> None:
    """Open the external I/O and fly the vehicles; all have landed and stopped on return."""
    async with ground.external_io as external_io:
        if external_io.disagreements:
            # The simulator would draw another world than the oracles judge: no flight is needed.
            text = "; ".join(external_io.disagreements)
            ground.run_state.decide("INVALID", text, source="simulator")
            return
        ground.run_state.environment |= external_io.environment
        await _fly_in_world(ground, inbox, disturb)


async def _fly_in_world(ground: GroundParts, inbox: OperatorInbox, disturb: Disturb | None) -> None:
    """Start the run's vehicles, fly them, and stop them before this returns."""
    setup, run_state = ground.setup, ground.run_state
    record = ground.sync.recording(ground.recorder.frame)
    async with (
        open_pair(
            setup,
            record=record,
            captures=ground.external_io.captures,
            tracks=ground.events.tracks,
        ) as pair,
        open_runners(setup, pair, run_state) as runners,
    ):
        run = flight_parts(ground, pair, runners, inbox)
        if disturb is not None:
            disturb(pair, run_state)
        await conduct_flight(run)
        ground.oracle_runner.last_state(asyncio.get_running_loop().time())


def _slow_autonomies(ground: GroundParts) -> tuple[SlowAutonomy, ...]:
    """Return the autonomies of a run that were slower than real time."""
    runners = () if ground.perception is None else ground.perception.runners.values()
    found = (runner.slow for runner in runners if isinstance(runner, AutonomyRunner))
    return tuple(slow_autonomy for slow_autonomy in found if slow_autonomy is not None)


def _report_unhandled(
    run_state: RunState,
    decide: TakeFault,
    _: asyncio.AbstractEventLoop,
    context: dict[str, Any],
) -> None:
    """Record an exception of a callback of the run's event loop, as of physics or recording."""
    error = context.get("exception")
    if isinstance(error, BaseException):
        decide(error, "in flight")
    else:
        run_state.decide("ERROR", f"in flight: {context.get('message', '')}")
