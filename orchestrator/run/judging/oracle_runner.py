"""Feeds the samples of a flight to the oracles, and their decisive events to the run state.

Selects the poses of a vehicle that are judged: at most 50 a second, also with jitter; pure.
"""

import asyncio
import math
from collections import defaultdict
from collections.abc import Callable, Mapping
from functools import partial
from typing import TypeVar, cast, get_args

from wil_campaign.foundation.clocks.sleeping import sleep_until
from wil_campaign.foundation.tasks import SuppressedErrors
from wil_campaign.orchestrator.run_results.result_parts import DropOut
from wil_campaign.orchestrator.run_results.run_result import FenceChange
from wil_campaign.orchestrator.state.run_state import RunState, Stage
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.safety.evaluation.judge import Judge
from wil_campaign.safety.evaluation.judge_log import ClockTick, LoggedSample
from wil_campaign.safety.evidence.evidence import POSE
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.model.oracle_results import Flag, OracleResult
from wil_campaign.safety.model.samples import (
    DoubtSample,
    DropOutSample,
    FenceSample,
    GroundSpeedSample,
    HeadingSample,
    LinkSample,
    PoseSample,
    ReferenceSample,
    ReportSample,
    StageSample,
    StateSample,
)
from wil_campaign.safety.model.samples import Stage as JudgedStage
from wil_campaign.vehicles.driver.onboard.gps_receiver import GroundSpeed
from wil_campaign.vehicles.driver.vehicle_state import VehicleEvent, VehicleState
from wil_campaign.vehicles.poses.headings import HeadingDifference
from wil_campaign.vehicles.poses.truth import TruthSample
from wil_campaign.worlds.frames import Vec3, norm, subtract

_EVERY_S = 0.02
_EARLY_S = 0.008
"""How early a pose may be. In simulation PX4 stamps messages sent at 50 Hz by the steps of its own
loop, 16 and 24 ms apart."""
_LEAP_M = 1.0
"""A pose that is so far from the last judged one is judged, too: others act on it, as the guard."""


class JudgedTimes:
    """Chooses the poses of one vehicle that are judged, by their times.

    Times are compared with a grid that a late pose does not shift: of a jittering source at 50 Hz
    each pose is judged, of one at 100 Hz every other.
    """

    def __init__(self) -> None:
        self._due_s = -math.inf
        self._place_m: Vec3 | None = None

    def is_due(self, t_s: float, place_ned_m: Vec3) -> bool:
        """Return whether the pose of a time is to be judged; if so, the next one is due later."""
        if t_s >= self._due_s - _EARLY_S:
            self._due_s = max(self._due_s, t_s - _EARLY_S) + _EVERY_S
        elif self._place_m is None or norm(subtract(place_ned_m, self._place_m)) <= _LEAP_M:
            return False
        self._place_m = place_ned_m
        return True


TICK_HZ = 10.0
_JUDGED_STAGES: frozenset[str] = frozenset(get_args(JudgedStage))
_WATCHER = SuppressedErrors("a watcher of an oracle's flags", later=True)
_CLEARANCE_KINDS = frozenset({"collision", "clearance"})

S = TypeVar("S", bound=LoggedSample)
FlagWatcher = Callable[[Flag], None]
SampleLogger = Callable[[LoggedSample], None]


class OracleRunner:
    """Runs the oracles in flight: feeds every sample to the judge, passes on every flag.

    log_sample: called with each sample before the judge gets it, so that the run can be judged
    again. kinds: of the oracles, by name. fence_changes: an operator's changes of judged fences,
    oldest first; changed_fences: the newest fence of each vehicle that got another one.
    """

    def __init__(
        self,
        *,
        judge: Judge,
        run_state: RunState,
        kinds: dict[str, str],
        flag_watchers: tuple[FlagWatcher, ...],
        log_sample: SampleLogger,
    ) -> None:
        self._judge = judge
        self._run_state = run_state
        self.kinds = kinds
        self._flag_watchers = flag_watchers
        self._log_sample = log_sample
        self._contexts: list[VehicleContext] = []
        self._judged_times: defaultdict[str, JudgedTimes] = defaultdict(JudgedTimes)
        self._reported_s: dict[tuple[str, str], float] = {}
        self._flags_passed_on = self._events_passed_on = 0
        self.fence_changes: list[FenceChange] = []
        self.changed_fences: dict[str, Fence] = {}
        run_state.on_stage(self._stage)
        run_state.on_drop_out(self._drop_out)

    def attach(self, context: VehicleContext) -> None:
        """Feed a vehicle's poses, state and link arrivals to the oracles from now on."""
        self._contexts.append(context)
        context.on_pose(self._pose)
        context.on_reference(self._reference)
        if self._judge.needs_ground_speed(context.name):
            context.driver.on_ground_speed(partial(self._ground_speed, context.name))
        if self._judge.needs_heading(context.name):
            context.driver.on_heading(partial(self._heading, context.name))
        context.driver.on_event(lambda event: self._event(context, event))
        context.driver.on_failure(lambda error: self._failure(context, str(error)))
        context.on_contact(lambda truth: self._contact(context, truth))

    async def run(self, alive: Callable[[], None]) -> None:
        """Tick the oracles until cancelled. alive: called at each tick."""
        loop = asyncio.get_running_loop()
        t0_s, count = loop.time(), 0
        while True:
            count += 1
            await sleep_until(t0_s + count / TICK_HZ)
            alive()
            for context in self._contexts:
                self._state(context, loop.time())
            tick = ClockTick(loop.time())
            self._feed(tick, lambda tick: self._judge.tick(tick.t_s))

    def clearance_m(self, t_s: float) -> float | None:
        """Return the least clearance so far of any collision or clearance oracle, or None."""
        results = [
            oracle.result(t_s)
            for oracle in self._judge.oracles
            if self.kinds.get(oracle.name) in _CLEARANCE_KINDS
        ]
        return min([r.actual for r in results if r.actual is not None], default=None)

    def results(self, t_s: float) -> tuple[tuple[OracleResult, bool], ...]:
        """Return the results so far, each with whether it has failed, whatever follows."""
        return self._judge.so_far(t_s)

    def change_fences(self, fences: Mapping[str, Fence], who: str) -> None:
        """Give the oracles changed fences of vehicles."""
        now_s = asyncio.get_running_loop().time()
        self.fence_changes.append(FenceChange(now_s, who, tuple(sorted(fences))))
        self.changed_fences |= fences
        for name, fence in fences.items():
            changed = FenceSample(now_s, name, fence)
            self._feed(changed, self._judge.fence)

    def report(self, sample: ReportSample) -> None:
        """Report to the oracles that a sample of a signal has arrived."""
        self._feed(sample, self._judge.report)

    def doubt(self, sample: DoubtSample) -> None:
        """Report to the oracles a signal that is not credible: the run is INVALID."""
        self._feed(sample, self._judge.doubt)

    def last_state(self, t_s: float) -> None:
        """Feed every vehicle's last state to the oracles."""
        for context in self._contexts:
            self._state(context, t_s)

    def _pose(self, sample: PoseSample) -> None:
        if self._judged_times[sample.vehicle].is_due(sample.t_s, sample.pose.position_ned_m):
            self._feed(sample, self._judge.pose)

    def _reference(self, sample: ReferenceSample) -> None:
        self._feed(sample, self._judge.reference)

    def _ground_speed(self, vehicle: str, speed: GroundSpeed) -> None:
        sample = GroundSpeedSample(
            speed.arrived_s, vehicle, "gps", speed.speed_m_s, speed.accuracy_m_s
        )
        self._feed(sample, self._judge.ground_speed)

    def _heading(self, vehicle: str, found: HeadingDifference) -> None:
        self._feed(HeadingSample(found.t_s, vehicle, *found[1:]), self._judge.heading)

    def _state(self, context: VehicleContext, t_s: float) -> None:
        if context.driver.state.last_received_s is None:
            return
        self._judge_arrivals(context)
        for name, reported_s in context.driver.reported_s.items():
            if reported_s > self._reported_s.get((context.name, name), -1.0):
                self._reported_s[context.name, name] = reported_s
                self.report(ReportSample(reported_s, context.name, name))
        self._judge_state(context, t_s)

    def _judge_arrivals(self, context: VehicleContext) -> None:
        for received_s in context.driver.take_arrivals():
            self._feed(LinkSample(received_s, context.name), self._judge.received)

    def _judge_state(self, context: VehicleContext, t_s: float) -> None:
        sample = state_sample(
            context.name,
            context.driver.state,
            t_s,
            permits_dead_reckoning=context.permits_dead_reckoning,
        )
        self._feed(sample, self._judge.state)

    def _event(self, context: VehicleContext, event: VehicleEvent) -> None:
        flies = self._run_state.reached("takeoff")
        if event.kind == "second_vehicle" and flies:
            self.doubt(DoubtSample(event.t_s, context.name, "identity", "mavlink", event.text))
        if event.kind == "unusable_estimate" and flies and context.pose_source == "mavlink":
            self.doubt(DoubtSample(event.t_s, context.name, POSE, "mavlink", event.text))
        if event.kind != "text":
            self._judge_state(context, event.t_s)

    def _failure(self, context: VehicleContext, reason: str) -> None:
        if context.may_drop_out and self._run_state.reached("takeoff"):
            self._run_state.drop_out(context.name, reason)
        else:
            self._run_state.decide("ERROR", reason)

    def _contact(self, context: VehicleContext, truth: TruthSample) -> None:
        """FAIL the run for a vehicle's physical contact, whatever the oracles judge."""
        self._run_state.decide(
            "FAIL",
            f"{context.name} physically touched {truth.contact}",
            t_s=truth.t_s,
            source=f"contact/{context.name}",
        )

    def _stage(self, stage: Stage, t_s: float) -> None:
        if stage in _JUDGED_STAGES:
            for context in self._contexts:
                # If this loop was late, what came before the stage must not look like a gap at it.
                self._judge_arrivals(context)
            self._feed(StageSample(t_s, cast("JudgedStage", stage)), self._judge.stage)

    def _drop_out(self, vehicle: str, left: DropOut) -> None:
        """End the oracles that only report on a vehicle that dropped out."""
        self._feed(DropOutSample(left.at_s, vehicle), self._judge.drop_out)

    def _feed(self, sample: S, judge: Callable[[S], tuple[Flag, ...] | None]) -> None:
        """Log a sample, judge it, and pass on what it decides, also where an oracle raised."""
        self._log_sample(sample)
        try:
            judge(sample)
        finally:
            self._pass_on_flags()

    def _pass_on_flags(self) -> None:
        """Pass on the new flags and decisive events of the judge."""
        for flag in self._judge.flags[self._flags_passed_on :]:
            self._flags_passed_on += 1
            for watcher in self._flag_watchers:
                with _WATCHER:
                    watcher(flag)
        for event in self._judge.decisive[self._events_passed_on :]:
            self._events_passed_on += 1
            self._run_state.decide(
                event.kind,
                event.text,
                t_s=event.t_s,
                source=event.source,
                ends_flight=self._judge.ends_flight(event),
            )


def state_sample(
    name: str, state: VehicleState, t_s: float, *, permits_dead_reckoning: bool = False
) -> StateSample:
    """Return a vehicle's reported state as a sample for the oracles.

    permits_dead_reckoning: a position that nothing holds any more is no fault.
    """
    estimator_faults = state.faults + (() if permits_dead_reckoning else state.position_losses)
    faults = [*estimator_faults, *(["failsafe"] if state.failsafe else [])]
    return StateSample(
        t_s=t_s,
        vehicle=name,
        armed=state.armed,
        mode=state.mode,
        mode_name=state.mode_name,
        landed=None if state.landed == "unknown" else state.landed == "on_ground",
        fault="; ".join(faults) or None,
        battery_fraction=None if state.battery is None else state.battery.remaining,
        battery_v=None if state.battery is None else state.battery.voltage_v,
        estimator_fault="; ".join(estimator_faults) or None,
        dead_reckoning="; ".join(state.position_losses) or None,
    )
