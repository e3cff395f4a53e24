"""A separate link to a ground station, for camera streams and contacts.

Encodes contacts as MAVLink messages for a ground station; pure.
"""

import asyncio
from collections.abc import Coroutine, Iterator, Mapping
from contextlib import AsyncExitStack
from typing import Any, Literal

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.orchestrator.state.observer import Observer
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.plugins.outlets.camera_component import CameraComponent, VideoStream
from wil_campaign.plugins.outlets.outlet_setups import DeliverySetups, GroundStationSetup
from wil_campaign.safety.model.oracle_results import Flag
from wil_campaign.vehicles.links.link import Link
from wil_campaign.vehicles.links.link_factory import open_link
from wil_campaign.vehicles.links.link_strings import parse_link
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec

Threat = Literal["none", "low", "high"]
_THREATS: dict[Threat, int] = {
    "none": mavlink.MAV_COLLISION_THREAT_LEVEL_NONE,
    "low": mavlink.MAV_COLLISION_THREAT_LEVEL_LOW,
    "high": mavlink.MAV_COLLISION_THREAT_LEVEL_HIGH,
}


def collision_message(
    *,
    thing_id: int,
    threat: Threat,
    time_to_closest_s: float,
    horizontal_m: float,
    vertical_m: float,
) -> Any:
    """Return a (virtual) contact or near miss as COLLISION (247), for ground stations.

    No autopilot acts on it. thing_id: the object's id, or an intruder's ICAO address.
    time_to_closest_s: 0 for contact. horizontal_m, vertical_m: separation at the closest.
    """
    return mavlink.MAVLink_collision_message(
        src=mavlink.MAV_COLLISION_SRC_ADSB,
        id=thing_id,
        action=mavlink.MAV_COLLISION_ACTION_REPORT,
        threat_level=_THREATS[threat],
        time_to_minimum_delta=time_to_closest_s,
        altitude_minimum_delta=vertical_m,
        horizontal_minimum_delta=horizontal_m,
    )


_TICK_S = 0.1
_FIRST_CAMERA = 100
"""MAV_COMP_ID_CAMERA; the next ones follow."""
_COMPANION = 191
"""MAV_COMP_ID_ONBOARD_COMPUTER: the sender of contacts."""


class GroundStation:
    """A separate link to a ground station, as components of the real vehicle.

    cameras: a component for each stream. The vehicle's own telemetry does not use this link.
    """

    def __init__(self, *, link: Link, system_id: int, cameras: tuple[CameraComponent, ...]) -> None:
        self.link = link
        self._cameras = cameras
        self._codecs = {
            camera.component_id: MavlinkCodec(system_id=system_id, component_id=camera.component_id)
            for camera in cameras
        }
        self._contacts = MavlinkCodec(system_id=system_id, component_id=_COMPANION)
        self._reader = MavlinkCodec(system_id=system_id, component_id=_COMPANION)
        link.receive(self._on_frame)

    async def run(self) -> None:
        """Send due messages to the ground station until cancelled."""
        loop = asyncio.get_running_loop()
        while True:
            for camera in self._cameras:
                self._send(camera, camera.tick(loop.time()))
            await asyncio.sleep(_TICK_S)

    def contact(self, text: str, *, object_id: int) -> None:
        """Send a contact to the ground station: COLLISION for machines, text for people.

        object_id: of the touched object in the world.
        """
        message = collision_message(
            thing_id=object_id,
            threat="high",
            time_to_closest_s=0.0,
            horizontal_m=0.0,
            vertical_m=0.0,
        )
        shown = mavlink.MAVLink_statustext_message(
            mavlink.MAV_SEVERITY_CRITICAL, text.encode()[:50]
        )
        self.link.write(self._contacts.pack(message) + self._contacts.pack(shown))

    def _on_frame(self, data: bytes, t_s: float) -> None:
        for message in self._reader.parse(data):
            for camera in self._cameras:
                self._send(camera, camera.receive(message, t_s))

    def _send(self, camera: CameraComponent, messages: list[Any]) -> None:
        codec = self._codecs[camera.component_id]
        for message in messages:
            self.link.write(codec.pack(message))


class GroundStationLink(Observer):
    """The ground station of one run: it is sent streams as a camera's, and contacts."""

    def __init__(self, setup: RunSetup, given: GroundStationSetup) -> None:
        self._objects = setup.judged_scene.objects
        system_id = setup.vehicle(setup.subject).system_id
        link = open_link(parse_link(given.link))
        cameras = tuple(_cameras(setup, system_id))
        self._station = GroundStation(link=link, system_id=system_id, cameras=cameras)

    async def open(self, stack: AsyncExitStack) -> None:
        """Open the link. Raises LinkError."""
        await stack.enter_async_context(self._station.link)

    def tasks(self, _run_state: RunState, /) -> Iterator[tuple[str, Coroutine[Any, Any, None]]]:
        """Yield what sends due messages."""
        yield "ground station", self._station.run()

    def contact(self, flag: Flag) -> None:
        """Send a contact to the ground station."""
        ids = (
            scene_object.object_id
            for scene_object in self._objects
            if scene_object.name in flag.text
        )
        self._station.contact(f"{flag.vehicle} {flag.text}", object_id=next(ids, 0))


def observe(
    setup: RunSetup, given: GroundStationSetup, _events: Mapping[str, float]
) -> GroundStationLink:
    """Return the ground station of a run."""
    return GroundStationLink(setup, given)


def _cameras(setup: RunSetup, system_id: int) -> Iterator[CameraComponent]:
    """Yield the camera component of each RTP stream of the subject's cameras."""
    deliveries = setup.case.observers.get("deliver")
    outlets = deliveries.outlets if isinstance(deliveries, DeliverySetups) else ()
    cameras = setup.vehicle(setup.subject).cameras
    for number, image_outlet in enumerate(outlet for outlet in outlets if outlet.kind == "rtp"):
        for camera in cameras:
            if camera.name == image_outlet.sensor:
                port = int(image_outlet.address.rpartition(":")[2])
                yield CameraComponent(
                    system_id=system_id,
                    intrinsics=camera.intrinsics,
                    stream=VideoStream(port=port, rate_hz=camera.rate_hz, name=image_outlet.topic),
                    component_id=_FIRST_CAMERA + number,
                )
