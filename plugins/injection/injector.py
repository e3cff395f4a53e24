"""Injects messages into autopilots: from mixed readings, from object positions, from poses.

Each message is sent through the vehicle's driver, and so through the guard. Nothing waits: a
message is sent when its reading arrives, if its period has passed.
"""

import asyncio
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from wil_campaign.orchestrator.model.external_results import InjectedResult
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.plugins.injection.injection_setups import InjectionSetup
from wil_campaign.plugins.injection.message_pacing import PLANS, InjectionPlan, PacedMessages
from wil_campaign.plugins.injection.pose_messages import (
    PoseSpread,
    landing_target,
    odometry,
    vision_position_estimate,
)
from wil_campaign.plugins.injection.range_messages import distance_sensor, obstacle_distance
from wil_campaign.plugins.injection.traffic_messages import Intruder, adsb_vehicle
from wil_campaign.vehicles.autopilots.autopilot import AutopilotName
from wil_campaign.vehicles.readings import (
    LidarScanReading,
    PoseReading,
    RangefinderReading,
    Reading,
)
from wil_campaign.worlds.frames import Vec3, scale, subtract
from wil_campaign.worlds.geodesy import LocalFrame
from wil_campaign.worlds.scene.scene import Scene, SceneObject

_ICAO_FIRST = 0xF00000
"""Addresses from F00000 on belong to no state (ICAO Annex 10, volume III, table 9-1)."""
_STEP_S = 0.1
"""The time step for the speed of an object."""
_TRAFFIC_HZ = 50.0


@dataclass(frozen=True, slots=True)
class ScenePoses:
    """The poses of the scene's objects for the injector. events: the world's, by time."""

    scene: Scene
    frame: LocalFrame
    events: Mapping[str, float]


class Injector:
    """Injects the campaign's messages into one vehicle's autopilot."""

    def __init__(
        self,
        *,
        context: VehicleContext,
        autopilot: AutopilotName,
        injections: Iterable[InjectionSetup],
        scene_poses: ScenePoses,
        spread: PoseSpread | None = None,
    ) -> None:
        self._context = context
        self._autopilot = autopilot
        self._scene_poses = scene_poses
        self._spread = spread
        self._injections = tuple(one for one in injections if context.name in one.to)
        self._paced: dict[tuple[str, str], PacedMessages] = {}

    @property
    def injections(self) -> tuple[InjectionSetup, ...]:
        """Return the injections into this vehicle."""
        return self._injections

    def perceived(self, sensor: str, reading: Reading) -> None:
        """Inject a sensor's mixed reading, if an injection uses it."""
        for one in self._injections:
            if one.sensor != sensor:
                continue
            if one.thing == "obstacle_distance" and isinstance(reading, LidarScanReading):
                self._offer(one, "", obstacle_distance(reading), reading.t_s)
            elif one.thing == "distance_sensor" and isinstance(reading, RangefinderReading):
                self._offer(one, "", distance_sensor(reading), reading.t_s)
            elif isinstance(reading, PoseReading):
                self._offer_pose(one, reading)

    def pose(self, reading: PoseReading) -> None:
        """Inject a motion capture pose, if an injection uses it."""
        for one in self._injections:
            if one.sensor is None:
                self._offer_pose(one, reading)

    async def run(self) -> None:
        """Inject messages about object positions until cancelled."""
        moving = [one for one in self._injections if one.objects]
        rate_hz = max((self._plan(one).rate_hz for one in moving), default=0.0)
        loop = asyncio.get_running_loop()
        while moving:
            for one in moving:
                self._send_objects(one, loop.time())
            await asyncio.sleep(1.0 / min(rate_hz, _TRAFFIC_HZ))

    @property
    def results(self) -> tuple[InjectedResult, ...]:
        """Return the counts of injected messages."""
        by_message: dict[str, list[PacedMessages]] = {one.thing: [] for one in self._injections}
        for (thing, _), paced in self._paced.items():
            by_message[thing].append(paced)
        return tuple(
            InjectedResult(
                vehicle=self._context.name,
                thing=thing,
                sent=sum(one.sent for one in paced),
                replaced=sum(one.replaced for one in paced),
                stale=sum(one.stale for one in paced),
            )
            for thing, paced in by_message.items()
        )

    def _offer_pose(self, one: InjectionSetup, reading: PoseReading) -> None:
        if one.thing == "vision_position_estimate":
            message = vision_position_estimate(reading, spread=self._spread)
            self._offer(one, "", message, reading.t_s)
        elif one.thing == "odometry" and self._has_velocity(reading):
            message = odometry(reading, autopilot=self._autopilot, spread=self._spread)
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
                self._offer(one, name, adsb_vehicle(intruder, now_s=now_s), now_s)
            else:
                message = self._landing_target(place, now_s)
                if message is not None:
                    self._offer(one, name, message, now_s)

    def _intruder(self, thing: SceneObject, place: Vec3, now_s: float) -> Intruder:
        events = self._scene_poses.events
        before = thing.pose_at(now_s - _STEP_S, events).position_ned_m
        at = self._scene_poses.frame.to_geodetic(place)
        return Intruder(
            t_s=now_s,
            icao_address=_ICAO_FIRST + thing.object_id,
            callsign=thing.name.upper(),
            latitude_deg=at.latitude_deg,
            longitude_deg=at.longitude_deg,
            altitude_amsl_m=at.altitude_m,
            velocity_ned_m_s=scale(subtract(place, before), 1.0 / _STEP_S),
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
