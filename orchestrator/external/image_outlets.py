"""Image outlets of a run: RTP, ZeroMQ and loopback devices."""

from collections.abc import Iterable
from contextlib import AsyncExitStack
from dataclasses import dataclass
from pathlib import Path

from campaigns.values.external_setups import ImageOutlet
from campaigns.values.sensor_setups import CameraSetup
from orchestrator.delivery.image_delivery import Delivery
from orchestrator.delivery.rtp import rtp_delivery
from orchestrator.delivery.sdp import RtpAddress
from orchestrator.delivery.v4l2 import v4l2_delivery
from orchestrator.delivery.zmq_images import ZmqDelivery
from orchestrator.model.external_results import OutletResult
from vehicles.readings import CameraReading


@dataclass(frozen=True, slots=True)
class Outlet:
    """An image outlet: a delivery, and which vehicle's camera it shows, perceived or raw."""

    delivery: Delivery
    sensor: str
    vehicle: str
    perceived: bool


class Outlets:
    """All image outlets of one run."""

    def __init__(self, outlets: Iterable[Outlet]) -> None:
        self._outlets = tuple(outlets)

    def __bool__(self) -> bool:
        return bool(self._outlets)

    async def open(self, stack: AsyncExitStack) -> None:
        """Open all image outlets. Raises DeliveryError."""
        for outlet in self._outlets:
            await stack.enter_async_context(outlet.delivery)

    def perceived(self, sensor: str, reading: CameraReading, by: Iterable[str]) -> None:
        """Deliver an image that vehicles perceive to its outlets."""
        receivers = frozenset(by)
        for outlet in self._outlets:
            if outlet.perceived and outlet.sensor == sensor and outlet.vehicle in receivers:
                outlet.delivery.deliver(reading)

    def untouched(self, sensor: str, reading: CameraReading) -> None:
        """Deliver an image as the camera took it to its outlets."""
        for outlet in self._outlets:
            if not outlet.perceived and (outlet.sensor, outlet.vehicle) == (sensor, reading.source):
                outlet.delivery.deliver(reading)

    @property
    def results(self) -> tuple[OutletResult, ...]:
        """Return the results of the image outlets."""
        return tuple(_result(outlet.delivery) for outlet in self._outlets)


def image_delivery(outlet: ImageOutlet, camera: CameraSetup, *, sdp_path: Path | None) -> Delivery:
    """Return the delivery of an image outlet, for a camera's image size and rate."""
    size = camera.intrinsics
    if outlet.kind == "zmq":
        return ZmqDelivery(address=outlet.address, topic=outlet.topic, encoding=outlet.encoding)
    if outlet.kind == "v4l2":
        return v4l2_delivery(
            device=Path(outlet.address),
            width_px=size.width_px,
            height_px=size.height_px,
            rate_hz=camera.rate_hz,
        )
    host, _, port = outlet.address.rpartition(":")
    return rtp_delivery(
        width_px=size.width_px,
        height_px=size.height_px,
        rate_hz=camera.rate_hz,
        address=RtpAddress(host, int(port)),
        sdp_path=sdp_path,
        key_interval_s=outlet.key_interval_s,
        max_bit_rate=outlet.max_bit_rate,
    )


def _result(delivery: Delivery) -> OutletResult:
    """Return the result of one image outlet."""
    counts = delivery.counts
    return OutletResult(
        name=delivery.name,
        offered=counts.offered,
        delivered=counts.delivered,
        dropped=counts.dropped,
        failed=counts.failed,
        trouble=delivery.trouble,
    )
