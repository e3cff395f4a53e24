"""The flight of an actor: a separate vehicle that flies as a moving object of the world.

The path of an actor: its object's motion as pose and velocity over time; pure.
"""

import asyncio
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

from wil_campaign.campaigns.setup.actor_setups import ActorSetup
from wil_campaign.campaigns.setup.case_setup import SyncSetup
from wil_campaign.foundation.clocks.sleeping import sleep_until
from wil_campaign.foundation.tasks import open_task_group, stop_tasks
from wil_campaign.orchestrator.run.stages.operator_hold import OperatorHold
from wil_campaign.orchestrator.run_results.run_result import ActorResult
from wil_campaign.orchestrator.state.run_state import FlightError, RunState
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.safety.evidence.poses import is_pose_finite
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.errors import VehicleError
from wil_campaign.vehicles.setpoints import VelocitySetpoint
from wil_campaign.worlds.figures import distinct_value_text
from wil_campaign.worlds.frames import Pose, Vec3, add, norm, scale, subtract
from wil_campaign.worlds.scene.motion import MotionLeg, ObjectMotion

_STEP_S = 0.05
_MOST_STEPS = 200
"""Into how many steps a long delay is divided at most, to find where on its path an actor is."""


class ActorWay:
    """The path of an actor along a motion that begins with a vertical climb.

    climb_m: height of that climb.
    """

    def __init__(self, motion: ObjectMotion) -> None:
        self._motion = motion
        begin, first = motion.begin.position_ned_m, motion.waypoints[0].position_ned_m
        self.climb_m = begin[2] - first[2]
        corners = [begin, *(waypoint.position_ned_m for waypoint in motion.waypoints)]
        self._stretches = tuple(pairwise(corners))

    def pose_at(self, since_s: float) -> Pose:
        """Return the pose of the motion at a time since its start."""
        leg = self._leg_at(since_s)
        return leg.begin.interpolate(leg.end, leg.share(since_s))

    def velocity_at(self, since_s: float) -> Vec3:
        """Return the velocity of the motion (NED) at a time since its start."""
        here, there = self.pose_at(since_s), self.pose_at(since_s + _STEP_S)
        return scale(subtract(there.position_ned_m, here.position_ned_m), 1.0 / _STEP_S)

    def speed_at(self, since_s: float) -> float:
        """Return the speed of the current leg at a time since the motion's start."""
        return self._leg_at(since_s).speed_m_s

    @property
    def duration_s(self) -> float:
        """Return how long the motion takes."""
        return self._motion.duration_s

    def _leg_at(self, since_s: float) -> MotionLeg:
        ends_later = (leg for leg in self._motion.legs if since_s < leg.begin_s + leg.duration_s)
        return next(ends_later, self._motion.legs[-1])

    def distance_m(self, place_ned_m: Vec3) -> float:
        """Return the distance of a position from the nearest point of the path."""
        return min(_distance_m(place_ned_m, begin, end) for begin, end in self._stretches)


class ActorProgress:
    """How far an actor has come along its path: the furthest place of it that it has reached.

    It counts as at that place of the path, between the furthest reached and the one where the
    motion is now, that is nearest to it: it never goes back, nor ahead of the motion, however
    often the path leads through one place.
    """

    def __init__(self, way: ActorWay) -> None:
        self._way = way
        self._reached_s = 0.0

    def behind_s(self, place_ned_m: Vec3, since_s: float) -> float:
        """Return how long before a time since its start the motion was where the actor is then."""
        now_s = min(since_s, self._way.duration_s)
        span_s = now_s - self._reached_s
        if span_s <= 0.0:
            return 0.0
        count = math.ceil(min(span_s / _STEP_S, _MOST_STEPS))
        times_s = [now_s - span_s * step / count for step in range(count + 1)]

        def off_m(t_s: float) -> float:
            return math.dist(self._way.pose_at(t_s).position_ned_m, place_ned_m)

        # The latest of equally near ones comes first: where the motion only turns, it waits.
        self._reached_s = max(self._reached_s, min(times_s, key=off_m))
        return now_s - self._reached_s


def _distance_m(place: Vec3, begin: Vec3, end: Vec3) -> float:
    """Return the distance of a position from a straight segment."""
    along = subtract(end, begin)
    length2 = sum(one * one for one in along)
    off = subtract(place, begin)
    share = 0.0 if length2 == 0.0 else sum(a * b for a, b in zip(off, along, strict=True)) / length2
    nearest = scale(along, min(max(share, 0.0), 1.0))
    return math.dist(off, nearest)


_SETPOINT_HZ = 20.0
_ARM_BEFORE_S = 2.0
"""How long before its takeoff command it arms: no autopilot disarms so soon."""
_FLIES = frozenset({"taking_off", "in_air"})
_OFF_GROUND_M = 0.15
"""Autopilots report a takeoff when they begin it, seconds before it leaves the ground."""
_LAG_S = 0.3
"""Lag of a quadrotor behind its velocity setpoint: setpoints are sent so much earlier."""
_GAIN_1_S = 1.0
"""Gain of the velocity towards the motion's position, added to the motion's own velocity."""
_CATCH_UP = 1.1
"""Largest speed of an actor that is behind, in times its motion's speed."""


@dataclass(slots=True, kw_only=True)
class ActorFlight:
    """Flies one actor along its object's motion, until the pair lands; then lands it.

    It is to leave the ground when the motion begins, so its commands are sent before that, as soon
    as the start event of the motion is known. If it leaves the ground later, it flies the whole
    motion with that delay. events: of the world. report_pose: called with each pose of the actor.
    send_anchors: called once arming has anchored its local frame anew.
    """

    setup: ActorSetup
    context: VehicleContext
    run_state: RunState
    operator_hold: OperatorHold
    sync: SyncSetup
    events: Mapping[str, float]
    report_pose: Callable[[PoseSample], None]
    send_anchors: Callable[[], None]
    landed: asyncio.Event = field(default_factory=asyncio.Event)
    _way: ActorWay = field(init=False)
    _progress: ActorProgress = field(init=False)
    _armed: bool = False
    _delay_s: float | None = None
    _offset_m: float = 0.0
    _last: PoseSample | None = None
    _alive_s: float = -math.inf
    """When its pose was last another one than before, or on the ground."""
    _is_nowhere: bool = False

    def __post_init__(self) -> None:
        self._way = ActorWay(self.setup.motion)
        self._progress = ActorProgress(self._way)
        self.context.on_pose(self._observe)
        self.context.driver.on_failure(lambda error: self._fail(str(error)))

    @property
    def _liftoff_s(self) -> float:
        """Return how long the actor's autopilot takes from the takeoff command to the liftoff."""
        return autopilot_named(self.setup.autopilot).liftoff_s

    @property
    def name(self) -> str:
        """Return the actor's name, which is the name of its object."""
        return self.setup.name

    def result(self) -> ActorResult:
        """Return how the actor flew."""
        return ActorResult(
            name=self.name,
            autopilot=self.setup.autopilot,
            flown_by=self.setup.kind,
            pose_source=self.setup.pose_source,
            delay_s=self._delay_s,
            offset_m=None if self._delay_s is None else self._offset_m,
        )

    async def fly(self) -> None:
        """Fly the actor until the pair lands, then land it; an error decides the run."""
        try:
            async with open_task_group() as tasks:
                watching = tasks.create_task(self._watch(), name=f"limits of {self.name}")
                flying = tasks.create_task(self._fly(), name=f"flight of {self.name}")
                await self.run_state.reaching("land")
                await stop_tasks(flying)
                await self._land()
                await stop_tasks(watching)
        except (VehicleError, FlightError) as error:
            self._fail(str(error))
        self.landed.set()

    def _fail(self, why: str) -> None:
        """End the run as ERROR: without its actor it proves nothing."""
        source = f"actor/{self.name}"
        if not self.run_state.reached("landed"):
            self.run_state.decide("ERROR", f"actor {why}", source=source)

    async def _fly(self) -> None:
        """Take off when the motion begins, and follow it; an error decides the run."""
        try:
            started_s = await self._started_s()
            async with open_task_group() as tasks:
                await self.operator_hold.through(lambda: self._take_off(started_s))
                self._delay_s = asyncio.get_running_loop().time() - started_s
                tasks.create_task(
                    self._follow(started_s + self._delay_s), name=f"{self.name} flies"
                )
                await self.operator_hold.through(self.context.driver.enter_guided)
                while True:
                    held = self.operator_hold.count
                    await self.operator_hold.resumed(after=held)
                    await self.operator_hold.through(self.context.driver.enter_guided)
        except (VehicleError, FlightError) as error:
            self._fail(str(error))

    async def _started_s(self) -> float:
        """Wait until the actor's motion is about to begin; return when it does."""
        while (started_s := self.setup.motion.start.started_s(self.events)) is None:
            await sleep_until(asyncio.get_running_loop().time() + 1.0 / _SETPOINT_HZ)
        await sleep_until(started_s - self._liftoff_s - _ARM_BEFORE_S)
        return started_s

    async def _take_off(self, started_s: float) -> None:
        """Arm the actor, command its takeoff in time, and wait until it leaves the ground."""
        driver = self.context.driver
        if self._armed and driver.state.landed in _FLIES:  # It took off before an operator's hold.
            return
        await driver.arm()
        self._armed = True
        self.send_anchors()
        await sleep_until(started_s - self._liftoff_s)
        await driver.begin_takeoff(self._way.climb_m)
        try:
            async with asyncio.timeout(self.sync.takeoff_timeout_s):
                while (self.context.height_m() or 0.0) < _OFF_GROUND_M:
                    await sleep_until(asyncio.get_running_loop().time() + 1.0 / _SETPOINT_HZ)
        except TimeoutError:
            within_s = self.sync.takeoff_timeout_s
            reason = f"{self.name} is still on the ground {within_s:g} s after its takeoff command"
            raise FlightError(reason) from None

    async def _follow(self, lifted_s: float) -> None:
        """Send the setpoints of the motion from the liftoff on, until cancelled."""
        loop = asyncio.get_running_loop()
        tick = 0
        while True:
            self.context.driver.send(self._setpoint(loop.time() - lifted_s))
            tick = max(tick + 1, int((loop.time() - lifted_s) * _SETPOINT_HZ))
            await sleep_until(lifted_s + tick / _SETPOINT_HZ)

    def _setpoint(self, since_s: float) -> VelocitySetpoint:
        """Return the velocity setpoint that follows the motion, at a time since the liftoff."""
        wanted = self._way.pose_at(since_s)
        velocity: Vec3 = self._way.velocity_at(since_s + _LAG_S)
        estimate = self.context.driver.estimate
        if estimate is not None:
            off = subtract(wanted.position_ned_m, estimate.pose.position_ned_m)
            velocity = add(velocity, scale(off, _GAIN_1_S))
        speed, most = norm(velocity), _CATCH_UP * self._way.speed_at(since_s)
        if speed > most:
            velocity = scale(velocity, most / speed)
        return VelocitySetpoint(velocity, yaw_rad=wanted.yaw_rad)

    async def _watch(self) -> None:
        """Watch the actor against its motion: beyond its limits the run is INVALID."""
        started_s = await self._started_s()
        loop = asyncio.get_running_loop()
        while not self.run_state.reached("landed"):
            if why := self._why_invalid(started_s, loop.time()):
                self._invalidate(why)
                return
            await asyncio.sleep(2.0 / _SETPOINT_HZ)

    def _why_invalid(self, started_s: float, now_s: float) -> str:
        """Return which limit the actor exceeds; empty for none. While it lands, it has no path."""
        limits, last = self.setup, self._last
        if self._is_nowhere:
            return "is at no place: its pose is not finite"
        if last is not None and not self.run_state.reached("land"):
            place_ned_m = last.pose.position_ned_m
            behind_s = self._progress.behind_s(place_ned_m, last.t_s - started_s)
            if behind_s > limits.max_delay_s:
                behind = distinct_value_text(behind_s, limits.max_delay_s, digits=1)
                return f"is {behind} s behind its motion (max_delay_s {limits.max_delay_s:g})"
        if self._offset_m > limits.max_offset_m:
            offset = distinct_value_text(self._offset_m, limits.max_offset_m)
            return f"is {offset} m off its path (max_offset_m {limits.max_offset_m:g})"
        if last is None or now_s - last.t_s > limits.max_silence_s:
            return f"has sent no pose for {limits.max_silence_s:g} s (max_silence_s)"
        if last.t_s - self._alive_s > limits.max_silence_s:
            return f"has repeated one pose for {limits.max_silence_s:g} s (max_silence_s)"
        return ""

    def _invalidate(self, why: str) -> None:
        reason = f"actor {self.name} {why}: the run did not fly what its world describes"
        self.run_state.decide("INVALID", reason, source=f"actor/{self.name}")

    def _observe(self, sample: PoseSample) -> None:
        if not is_pose_finite(sample):
            self._is_nowhere |= self._delay_s is not None
            return
        if self._last is None or sample.pose != self._last.pose or not self._is_aloft(sample):
            self._alive_s = sample.t_s
        self._last = sample
        if self._delay_s is not None and not self.run_state.reached("land"):
            self._offset_m = max(self._offset_m, self._way.distance_m(sample.pose.position_ned_m))
        self.report_pose(sample)

    def _is_aloft(self, sample: PoseSample) -> bool:
        """Return whether the actor is off the ground, where no sound pose is equal to the last."""
        ground_ned_m = self.setup.motion.begin.position_ned_m
        height_m = ground_ned_m[2] - sample.pose.position_ned_m[2]
        return self._delay_s is not None and height_m > _OFF_GROUND_M

    async def _land(self) -> None:
        driver = self.context.driver
        if driver.state.armed:
            await driver.land()
            await driver.disarmed(self.sync.landing_timeout_s)
