"""Injects messages into autopilots: from mixed readings, from object positions, from poses.

Each message is sent through the vehicle's driver, and so through the guard. Nothing waits: a
message is sent when its reading arrives, if its period has passed.

Paces injected messages to the autopilot at their rates, and drops stale ones; pure.
"""

import asyncio
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from wil_campaign.orchestrator.run_results.result_parts import InjectedResult
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.plugins.injection.injection_setups import InjectionSetup
from wil_campaign.plugins.injection.pose_messages import (
    PoseSpread,
    landing_target,
    odometry_message,
    vision_position_estimate,
)
from wil_campaign.plugins.injection.range_messages import (
    distance_sensor_message,
    nothing_measured,
    obstacle_distance,
)
from wil_campaign.plugins.injection.traffic_messages import Intruder, adsb_vehicle
from wil_campaign.vehicles.readings import (
    LidarScanReading,
    PoseReading,
    RangefinderReading,
    Reading,
)
from wil_campaign.worlds.frames import Pose, Vec3, scale, subtract
from wil_campaign.worlds.geodesy import LocalFrame
from wil_campaign.worlds.scene.scene import Scene, SceneObject


@dataclass(frozen=True, slots=True)
class InjectionPlan:
    """The pacing of an injected message: how often it is sent, how old it may be.

    rate_hz: highest rate; a slower feed is sent as it comes. max_age_s: older messages are not
    sent, so that the autopilot's own time-out detects a dead feed.
    """

    rate_hz: float
    max_age_s: float

    def __post_init__(self) -> None:
        if not (0.0 < self.rate_hz < math.inf and self.max_age_s > 0.0):
            raise ValueError(f"{self}: rate_hz and max_age_s must be positive")


_EARLY = 0.1
"""Tolerated share of a period: a feed of the same rate with jitter is sent whole."""

PLANS: dict[str, InjectionPlan] = {
    # ArduPilot and PX4 forget obstacles after 0.5 s.
    "obstacle_distance": InjectionPlan(10.0, 0.2),
    "distance_sensor": InjectionPlan(20.0, 0.2),
    # Transponders send once a second; ArduPilot forgets after 5 s.
    "adsb_vehicle": InjectionPlan(1.0, 2.0),
    "collision": InjectionPlan(10.0, 0.5),
    # ArduPilot forgets after 1 s, PX4 after PLD_BTOUT.
    "landing_target": InjectionPlan(20.0, 0.2),
    # PX4 requires gaps below 0.2 s, ArduPilot below 0.3 s; both recommend 30 to 50 Hz.
    "vision_position_estimate": InjectionPlan(50.0, 0.1),
    "odometry": InjectionPlan(50.0, 0.1),
}
"""Default plans, by the name of the injected message; see docs/delivery.md."""


class PacedMessages:
    """Paces messages of one kind: holds the newest and returns it when due."""

    def __init__(self, plan: InjectionPlan) -> None:
        self._plan = plan
        self._message: Any = None
        self._t_s = -math.inf
        self._due_s = -math.inf
        self.sent = 0
        self.replaced = 0
        self.stale = 0

    def offer(self, message: Any, t_s: float) -> None:
        """Offer a message of a run-clock time; it replaces an unsent earlier one."""
        self.replaced += self._message is not None
        self._message, self._t_s = message, t_s

    def due(self, now_s: float) -> Any | None:
        """Return the message that is due to be sent now; each at most once."""
        if self._message is None or now_s < self._due_s - _EARLY / self._plan.rate_hz:
            return None
        message, self._message = self._message, None
        if now_s - self._t_s > self._plan.max_age_s:
            self.stale += 1
            return None
        period_s = 1.0 / self._plan.rate_hz
        self._due_s = (now_s if now_s - self._due_s >= period_s else self._due_s) + period_s
        self.sent += 1
        return message


_ICAO_FIRST = 0xF00000
"""Addresses from F00000 on belong to no state (ICAO Annex 10, volume III, table 9-1)."""
_STEP_S = 0.1
"""The time step for the speed of an object."""
_TRAFFIC_HZ = 50.0
_OF_RANGES = frozenset({"obstacle_distance", "distance_sensor"})
_STAND_BY_S = 0.2
"""ArduPilot takes a range sensor for dead after 0.5 s."""


@dataclass(frozen=True, slots=True)
class ScenePoses:
    """The poses of the scene's objects for the injector. events: the world's, by time."""

    scene: Scene
    frame: LocalFrame
    events: Mapping[str, float]


class Injector:
    """Injects the campaign's messages into one vehicle's autopilot.

    is_attached: the vehicle stands anywhere on Earth, and its world with it. mounts: of its
    rangefinders, by name.
    """

    def __init__(
        self,
        *,
        context: VehicleContext,
        autopilot: str,
        injections: Iterable[InjectionSetup],
        scene_poses: ScenePoses,
        spread: PoseSpread | None = None,
        is_attached: bool = False,
        mounts: Mapping[str, Pose] = MappingProxyType({}),
    ) -> None:
        self._context = context
        self._mounts = mounts
        self._is_attached = is_attached
        self._autopilot = autopilot
        self._scene_poses = scene_poses
        self._spread = spread
        self._injections = tuple(
            injection for injection in injections if context.name in injection.to
        )
        self._paced: dict[tuple[str, str], PacedMessages] = {}

    @property
    def injections(self) -> tuple[InjectionSetup, ...]:
        """Return the injections into this vehicle."""
        return self._injections

    def perceived(self, sensor: str, reading: Reading) -> None:
        """Inject a sensor's mixed reading, if an injection uses it."""
        for injection in self._injections:
            if injection.sensor != sensor or injection.only_stands_by:
                continue
            if injection.thing == "obstacle_distance" and isinstance(reading, LidarScanReading):
                self._offer(injection, "", obstacle_distance(reading), reading.t_s)
            elif injection.thing == "distance_sensor" and isinstance(reading, RangefinderReading):
                self._offer(injection, "", distance_sensor_message(reading), reading.t_s)
            elif isinstance(reading, PoseReading):
                self._offer_pose(injection, reading)

    def pose(self, reading: PoseReading) -> None:
        """Inject a motion capture pose, if an injection uses it."""
        for injection in self._injections:
            if injection.sensor is None:
                self._offer_pose(injection, reading)

    async def stand_by(self, run_state: RunState) -> None:
        """Send that range sensors have measured nothing yet, until the takeoff; or all the time.

        It begins once the vehicle is identified. Mixed readings begin with the takeoff, and an
        ArduCopter that is to listen to a sensor does not arm while it is silent: "PreArm: PRX1: No
        Data" (AP_Proximity::prearm_healthy). In flight a feed that is dead has to look so.
        """
        of_ranges = [one for one in self._injections if one.thing in _OF_RANGES]
        await run_state.reaching("ready")
        while of_ranges:
            if run_state.reached("takeoff"):
                of_ranges = [one for one in of_ranges if one.only_stands_by]
            now_s = asyncio.get_running_loop().time()
            for one in of_ranges:
                beams = self._mounts if one.thing == "distance_sensor" else {}
                message = nothing_measured(beams.get(one.sensor or ""), now_s)
                self._context.driver.send_message(message)
            await asyncio.sleep(_STAND_BY_S)

    async def run(self) -> None:
        """Inject messages about object positions until cancelled."""
        moving = [injection for injection in self._injections if injection.objects]
        rate_hz = max((self._plan(one).rate_hz for one in moving), default=0.0)
        loop = asyncio.get_running_loop()
        while moving:
            for one in moving:
                self._send_objects(one, loop.time())
            await asyncio.sleep(1.0 / min(rate_hz, _TRAFFIC_HZ))

    @property
    def results(self) -> tuple[InjectedResult, ...]:
        """Return the counts of injected messages."""
        by_message: dict[str, list[PacedMessages]] = {
            injection.thing: [] for injection in self._injections if not injection.only_stands_by
        }
        for (thing, _), paced in self._paced.items():
            by_message[thing].append(paced)
        return tuple(
            InjectedResult(
                vehicle=self._context.name,
                thing=thing,
                sent=sum(paced_messages.sent for paced_messages in paced),
                replaced=sum(paced_messages.replaced for paced_messages in paced),
                stale=sum(paced_messages.stale for paced_messages in paced),
            )
            for thing, paced in by_message.items()
        )

    def _offer_pose(self, one: InjectionSetup, reading: PoseReading) -> None:
        if one.thing == "vision_position_estimate":
            message = vision_position_estimate(reading, spread=self._spread)
            self._offer(one, "", message, reading.t_s)
        elif one.thing == "odometry" and self._has_velocity(reading):
            message = odometry_message(reading, autopilot=self._autopilot, spread=self._spread)
            self._offer(one, "", message, reading.t_s)

    def _offer(self, one: InjectionSetup, which: str, message: Any, t_s: float) -> None:
        paced = self._paced.setdefault((one.thing, which), PacedMessages(self._plan(one)))
        paced.offer(message, t_s)
        due = paced.due(asyncio.get_running_loop().time())
        if due is not None:
            self._context.driver.send_message(due)

    def _plan(self, one: InjectionSetup) -> InjectionPlan:
        usual = PLANS[one.thing]
        return InjectionPlan(one.rate_hz or usual.rate_hz, usual.max_age_s)

    def _has_velocity(self, reading: PoseReading) -> bool:
        return reading.velocity_ned_m_s is not None or self._autopilot == "px4"

    def _send_objects(self, one: InjectionSetup, now_s: float) -> None:
        for name in one.objects:
            thing = self._scene_poses.scene[name]
            place = thing.pose_at(now_s, self._scene_poses.events).position_ned_m
            if one.thing == "adsb_vehicle":
                intruder = self._intruder(thing, place, now_s)
                if intruder is not None:
                    self._offer(one, name, adsb_vehicle(intruder, now_s=now_s), now_s)
            else:
                message = self._landing_target(place, now_s)
                if message is not None:
                    self._offer(one, name, message, now_s)

    def _intruder(self, thing: SceneObject, place: Vec3, now_s: float) -> Intruder | None:
        """Return an object as an intruder on Earth; None while the vehicle's place is unknown."""
        events = self._scene_poses.events
        before = thing.pose_at(now_s - _STEP_S, events).position_ned_m
        velocity_ned_m_s = scale(subtract(place, before), 1.0 / _STEP_S)
        at = self._scene_poses.frame.to_geodetic(place)
        if self._is_attached:
            driver = self._context.driver
            anchor = driver.anchor
            if anchor is None or driver.place_deg is None:
                return None
            at = driver.place_of(place)
            velocity_ned_m_s = anchor.velocity_to_local(velocity_ned_m_s)
        return Intruder(
            t_s=now_s,
            icao_address=_ICAO_FIRST + thing.object_id,
            callsign=thing.name.upper(),
            latitude_deg=at.latitude_deg,
            longitude_deg=at.longitude_deg,
            altitude_amsl_m=at.altitude_m,
            velocity_ned_m_s=velocity_ned_m_s,
        )

    def _landing_target(self, place: Vec3, now_s: float) -> Any | None:
        """Return the LANDING_TARGET in the autopilot's frame; None while its pose is unknown."""
        driver = self._context.driver
        anchor, local = driver.anchor, driver.state.local
        if anchor is None or local is None:
            return None
        return landing_target(
            now_s,
            target_ned_m=anchor.position_to_local(place),
            body=local.pose,
            autopilot=self._autopilot,
        )
