"""A separate link to a ground station, for camera streams and contacts."""

import asyncio
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from orchestrator.delivery.camera_component import CameraComponent
from orchestrator.delivery.traffic_messages import collision
from vehicles.links.link import Link
from vehicles.mavlink.codec import Codec

_TICK_S = 0.1
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
            camera.component_id: Codec(system_id=system_id, component_id=camera.component_id)
            for camera in cameras
        }
        self._contacts = Codec(system_id=system_id, component_id=_COMPANION)
        self._reader = Codec(system_id=system_id, component_id=_COMPANION)
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
        message = collision(
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
                self._send(camera, camera.take(message, t_s))

    def _send(self, camera: CameraComponent, messages: list[Any]) -> None:
        codec = self._codecs[camera.component_id]
        for message in messages:
            self.link.write(codec.pack(message))
