"""Outlets of a run: images by RTP, ZeroMQ and loopback devices, other readings by ZeroMQ."""

import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import AsyncExitStack
from dataclasses import dataclass
from pathlib import Path

from wil_campaign.campaigns.values.sensor_setups import CameraSetup
from wil_campaign.orchestrator.run_results.result_parts import ExternalResult, OutletResult
from wil_campaign.orchestrator.state.observer import Observer
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.plugins.outlets.image_delivery import ImageDelivery
from wil_campaign.plugins.outlets.outlet_setups import DeliverySetups, ImageOutlet
from wil_campaign.plugins.outlets.perceived_cameras import perceived_cameras
from wil_campaign.plugins.outlets.rtp import rtp_delivery
from wil_campaign.plugins.outlets.sdp import RtpAddress
from wil_campaign.plugins.outlets.v4l2 import v4l2_delivery
from wil_campaign.plugins.outlets.zmq_images import ZmqDelivery
from wil_campaign.vehicles.readings import Reading

_MOST_WAITING = 128


@dataclass(frozen=True, slots=True)
class OpenOutlet:
    """An outlet: a delivery, and which vehicle's sensor it sends, perceived or raw."""

    delivery: ImageDelivery
    sensor: str
    vehicle: str
    perceived: bool


class RunOutlets(Observer):
    """All image outlets of one run."""

    def __init__(self, outlets: Iterable[OpenOutlet]) -> None:
        self._outlets = tuple(outlets)

    async def open(self, stack: AsyncExitStack) -> None:
        """Open all image outlets. Raises DeliveryError."""
        for outlet in self._outlets:
            await stack.enter_async_context(outlet.delivery)

    def perceived(self, reading: Reading, by: tuple[str, ...]) -> None:
        """Deliver a reading that vehicles perceive to its outlets."""
        for outlet in self._outlets:
            if outlet.perceived and outlet.sensor == reading.sensor and outlet.vehicle in by:
                outlet.delivery.deliver(reading)

    def untouched(self, reading: Reading) -> None:
        """Deliver a reading as its sensor made it to its outlets."""
        taken = (reading.sensor, reading.source)
        for outlet in self._outlets:
            if not outlet.perceived and (outlet.sensor, outlet.vehicle) == taken:
                outlet.delivery.deliver(reading)

    @property
    def environment(self) -> Mapping[str, str]:
        """Return WIL_ZMQ: a list in JSON of the ZeroMQ outlets, and where each is subscribed to."""
        published = [
            {
                "sensor": outlet.sensor,
                "of": "perceived" if outlet.perceived else outlet.vehicle,
                "vehicle": outlet.vehicle,
                "address": outlet.delivery.endpoint,
                "topic": outlet.delivery.topic,
            }
            for outlet in self._outlets
            if isinstance(outlet.delivery, ZmqDelivery)
        ]
        return {"WIL_ZMQ": json.dumps(published)} if published else {}

    @property
    def result(self) -> ExternalResult:
        """Return the results of the image outlets."""
        return ExternalResult(outlets=tuple(_result(outlet.delivery) for outlet in self._outlets))


def observe(setup: RunSetup, given: DeliverySetups, _events: Mapping[str, float]) -> RunOutlets:
    """Return the image outlets of a run."""
    return RunOutlets(_outlets(setup, given))


def _outlets(setup: RunSetup, given: DeliverySetups) -> Iterator[OpenOutlet]:
    there = {vehicle.name: vehicle for vehicle in setup.with_sensors}
    for outlet in given.outlets:
        perceived = outlet.of == "perceived"
        name = (outlet.vehicle or setup.subject) if perceived else outlet.of
        if name not in there:
            continue
        if outlet.sensor not in {camera.name for camera in there[name].cameras}:
            yield OpenOutlet(_reading_delivery(outlet), outlet.sensor, name, perceived)
            continue
        cameras = {camera.name: camera for camera in there[name].cameras}
        if perceived:
            shown = perceived_cameras(setup.case, setup.mode, name)
            cameras |= {camera.name: camera for camera in shown}
        camera = cameras[outlet.sensor]
        sdp = setup.order.folder / f"{outlet.sensor}-{outlet.of}.sdp"
        delivery = image_delivery(outlet, camera, sdp_path=sdp)
        yield OpenOutlet(delivery, outlet.sensor, name, perceived)


def _reading_delivery(outlet: ImageOutlet) -> ImageDelivery:
    """Return the delivery of a sensor that is no camera: some of them send hundreds a second."""
    return ZmqDelivery(address=outlet.address, topic=outlet.topic, depth=_MOST_WAITING)


def image_delivery(
    outlet: ImageOutlet, camera: CameraSetup, *, sdp_path: Path | None
) -> ImageDelivery:
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


def _result(delivery: ImageDelivery) -> OutletResult:
    counts = delivery.counts
    return OutletResult(
        name=delivery.name,
        offered=counts.offered,
        delivered=counts.delivered,
        dropped=counts.dropped,
        failed=counts.failed,
        trouble=delivery.trouble,
    )
