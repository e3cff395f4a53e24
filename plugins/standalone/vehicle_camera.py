"""The camera of a stand-alone embedded vehicle: rendered, sent by RTP, announced over MAVLink."""

import asyncio
import math
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import numpy as np

from wil_campaign.plugins.outlets.camera_component import CameraComponent, VideoStream
from wil_campaign.plugins.outlets.image_delivery import ImageDelivery
from wil_campaign.plugins.outlets.rtp import rtp_delivery
from wil_campaign.plugins.outlets.sdp import RtpAddress
from wil_campaign.vehicles.cameras.camera_effects import CameraQuality
from wil_campaign.vehicles.cameras.rendered_cameras import CameraCompute, RenderedCamera
from wil_campaign.vehicles.embedded.process.vehicle_faults import VehicleFaults
from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle
from wil_campaign.vehicles.poses.pose_history import PoseHistory
from wil_campaign.vehicles.poses.truth import TruthSample
from wil_campaign.vehicles.readings import CameraReading, Reading
from wil_campaign.vehicles.readings.copies import restamp_reading
from wil_campaign.vehicles.sensors.world_views import WorldImages
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import AT_ORIGIN
from wil_campaign.worlds.scene.scene import Scene

INTRINSICS = Intrinsics.from_fov(640, 480, math.radians(69.0))
RATE_HZ = 15.0
_HISTORY_S = 2.0
_TRUTH_HZ = 125.0
_POSE_DELAY_S = 0.01
"""How long after an exposure its pose is available: the vehicle steps 8 ms at a time."""
_SEED = 3
"""Separates the camera's noise from the vehicle's."""


class VehicleCamera:
    """A camera at the nose of an embedded vehicle, level with its body.

    scene: the world that it shows, with moving objects at their start. quality: noise, blur and
    latency. port: announced UDP port of the stream that `delivery` sends. compute: runs rendering;
    in a thread by default.
    """

    def __init__(
        self,
        *,
        scene: Scene,
        quality: CameraQuality,
        delivery: ImageDelivery,
        port: int,
        seed: int = 1,
        compute: CameraCompute = asyncio.to_thread,
    ) -> None:
        self._images = WorldImages(scene=scene, events={})
        self._quality = quality
        self._delivery = delivery
        self._port = port
        self._rng = np.random.default_rng([seed, _SEED])
        self._compute = compute

    def warm_up(self) -> None:
        """Render once: the first time after installation compiles kernels for up to a minute."""
        self._images.picture(AT_ORIGIN, INTRINSICS, 0.0)

    @asynccontextmanager
    async def attach(self, vehicle: EmbeddedVehicle, faults: VehicleFaults) -> AsyncIterator[None]:
        """Render, send and announce a vehicle's camera within the context. Raises DeliveryError."""
        history = PoseHistory(_HISTORY_S)

        def add(sample: TruthSample) -> None:
            history.add(sample.t_s, sample.pose, sample.velocity_ned_m_s)

        def deliver(reading: Reading) -> None:
            if isinstance(reading, CameraReading):
                self._delivery.deliver(reading)

        camera = RenderedCamera(
            source=self._images,
            history=history,
            intrinsics=INTRINSICS,
            rate_hz=RATE_HZ,
            side="real",
            rng=self._rng,
            quality=self._quality,
            compute=self._compute,
            pose_delay_s=_POSE_DELAY_S,
        )
        through: Callable[[Reading], None] = faults.through("camera", restamp_reading, deliver)
        async with self._delivery, asyncio.TaskGroup() as tasks:
            vehicle.on_truth(add, _TRUTH_HZ)
            vehicle.add_component(self._component(vehicle))
            rendering = tasks.create_task(camera.run(through), name="vehicle's camera")
            try:
                yield
            finally:
                rendering.cancel()

    def _component(self, vehicle: EmbeddedVehicle) -> CameraComponent:
        return CameraComponent(
            system_id=vehicle.config.system_id,
            intrinsics=INTRINSICS,
            stream=VideoStream(port=self._port, rate_hz=RATE_HZ, name="camera"),
            model="rendered camera",
            start_s=asyncio.get_running_loop().time(),
        )


def rtp_camera(
    *, scene: Scene, quality: CameraQuality, address: RtpAddress, seed: int
) -> VehicleCamera:
    """Return a vehicle's camera whose images are sent to an address by RTP as H.264."""
    delivery = rtp_delivery(
        width_px=INTRINSICS.width_px,
        height_px=INTRINSICS.height_px,
        rate_hz=RATE_HZ,
        address=address,
    )
    return VehicleCamera(
        scene=scene, quality=quality, delivery=delivery, port=address.port, seed=seed
    )
