"""`deliver` and `ground_station`: outlets for images other than the autonomy in this process."""

import re
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from wil_campaign.campaigns.schema import CameraPart, CampaignPart
from wil_campaign.foundation.files.documents import Document, KeyFaultError, Part, Problem
from wil_campaign.plugins.outlets.outlet_setups import (
    DeliverySetups,
    GroundStationSetup,
    ImageOutlet,
)
from wil_campaign.recipes.working import Side
from wil_campaign.vehicles.links.link_strings import LinkAddressError, parse_link

_HOST_PORT = re.compile(r"([^:/@\s]+):(\d{1,5})")
_KINDS: tuple[Literal["rtp", "zmq", "v4l2"], ...] = ("rtp", "zmq", "v4l2")
_ONLY_FOR = {
    "encoding": "zmq",
    "topic": "zmq",
    "key_interval_s": "rtp",
    "max_bit_rate": "rtp",
}


class DeliverPart(Part):
    """An image delivery: `rtp: HOST:PORT`, `zmq: tcp://HOST:PORT` or `v4l2: /dev/videoN`.

    sensor: the camera, or of zmq any sensor; optional where there is only one camera. of: what a
    vehicle perceives (mixed, in mode wil), or the unmixed reading of real or twin. vehicle: whose
    perception; by default that of the judged one. rtp: send H.264 by RTP to this HOST:PORT; the
    port is even. zmq: publish by ZeroMQ at this address to bind; port * is a free one. v4l2: write
    to this video loopback device. encoding: how zmq encodes the images. topic: the topic under
    which zmq publishes. key_interval_s: longest time between two key frames of rtp. max_bit_rate:
    the highest bit rate of rtp, in bits per second; by default not limited.
    """

    rtp: str | None = None
    zmq: str | None = None
    v4l2: str | None = None
    sensor: str | None = None
    of: Literal["perceived", "real", "twin"] = "perceived"
    vehicle: Side | None = None
    encoding: Literal["bgr8", "png", "jpeg"] = "bgr8"
    topic: Annotated[str, Field(min_length=1, max_length=100)] = "mixed"
    key_interval_s: Annotated[float, Field(gt=0, le=60)] = 1.0
    max_bit_rate: Annotated[int, Field(ge=10_000, le=1_000_000_000)] | None = None

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        given = [kind for kind in _KINDS if getattr(self, kind) is not None]
        if len(given) != 1:
            raise ValueError(f"give one of {', '.join(_KINDS)}, with its address")
        for key, kind in _ONLY_FOR.items():
            if key in self.model_fields_set and kind != given[0]:
                raise KeyFaultError(key, f"is for {kind}, not for {given[0]}")
        if self.vehicle is not None and self.of != "perceived":
            raise KeyFaultError("vehicle", f"has no effect with of: {self.of}; remove it")
        _check_address(given[0], str(getattr(self, given[0])))
        return self

    def outlet(self, default_sensor: str) -> ImageOutlet:
        """Return the image outlet of a delivery; default_sensor where none is named."""
        kind = next(kind for kind in _KINDS if getattr(self, kind) is not None)
        return ImageOutlet(
            kind=kind,
            address=str(getattr(self, kind)),
            sensor=self.sensor or default_sensor,
            of=self.of,
            vehicle=self.vehicle,
            encoding=self.encoding,
            topic=self.topic,
            key_interval_s=self.key_interval_s,
            max_bit_rate=self.max_bit_rate,
        )


def _check_address(kind: str, address: str) -> None:
    """Refuse a delivery address of the wrong form: rtp, zmq or v4l2."""
    if kind == "rtp":
        match = _HOST_PORT.fullmatch(address)
        if match is None or not 0 < int(match[2]) < 65536:
            raise KeyFaultError("rtp", "must be HOST:PORT, as in 127.0.0.1:5600")
        if int(match[2]) % 2:
            raise KeyFaultError("rtp", "RTP needs an even port; the next one is for RTCP")
    elif kind == "zmq":
        if not re.fullmatch(r"(tcp://[^:/\s]+:(\d{1,5}|\*)|ipc://\S+)", address):
            raise KeyFaultError("zmq", "must be an address to bind, as tcp://127.0.0.1:5601")
    elif not address.startswith("/dev/"):
        raise KeyFaultError("v4l2", "must be a loopback device, as /dev/video10")


def ground_station_link(link: str) -> str:
    """Return a link that can lead to a ground station. Raises ValueError."""
    try:
        address = parse_link(link)
    except LinkAddressError as error:
        raise ValueError(f"is not a link: {error}") from error
    if address.kind not in {"udpout", "tcpout"}:
        raise ValueError("must be outgoing: udpout://HOST:14550 or tcpout://HOST:PORT")
    return link


def deliver_field() -> tuple[Any, Any]:
    """Return the type and the field of the key `deliver`."""
    summary = "Outlets for images and other readings, beside the autonomy."
    return list[DeliverPart], Field(default_factory=list, description=summary)


def ground_station_field() -> tuple[Any, Any]:
    """Return the type and the field of the key `ground_station`."""
    summary = "Outgoing link of a ground station that receives video streams and contacts."
    link = Annotated[str, AfterValidator(ground_station_link)] | None
    return link, Field(default=None, description=summary)


def delivery_setups(
    given: list[DeliverPart], file: Document, part: CampaignPart, problems: list[Problem]
) -> DeliverySetups | None:
    """Return the deliveries of a case; None without any.

    A delivery without a camera's name is a problem where there are several cameras.
    """
    cameras = sorted(
        {
            name
            for vehicle in (part.vehicles.real, part.vehicles.twin)
            for name, sensor in (vehicle.sensors.items() if vehicle is not None else ())
            if isinstance(sensor, CameraPart)
        }
    )
    outlets = []
    for index, deliver in enumerate(given):
        if deliver.sensor is None and len(cameras) != 1:
            there = ", ".join(cameras) or "none"
            message = f"name the camera by `sensor` (there are: {there})"
            problems.append(file.problem(("deliver", index), message))
        outlets.append(deliver.outlet(cameras[0] if cameras else ""))
    return DeliverySetups(tuple(outlets)) if outlets else None


def ground_station_setup(
    given: str | None, _campaign: Document, _part: CampaignPart, _problems: list[Problem]
) -> GroundStationSetup | None:
    """Return the ground station of a case; None without one."""
    return None if given is None else GroundStationSetup(given)
