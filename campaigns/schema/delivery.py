"""`deliver` and `inject`: outlets for mixed readings other than the autonomy in this process."""

import re
from typing import Annotated, Literal, Self

from pydantic import Field, field_validator, model_validator

from campaigns.values.external_setups import ImageOutlet, InjectionSetup
from recipes.working import SIDES, Side
from vehicles.links.link_strings import LinkAddressError, parse_link
from worlds.files.documents import KeyFaultError, Part

_HOST_PORT = re.compile(r"([^:/@\s]+):(\d{1,5})")
_KINDS: tuple[Literal["rtp", "zmq", "v4l2"], ...] = ("rtp", "zmq", "v4l2")
_ONLY_FOR = {
    "encoding": "zmq",
    "topic": "zmq",
    "key_interval_s": "rtp",
    "max_bit_rate": "rtp",
}
RateHz = Annotated[float, Field(gt=0, le=250)]


class DeliverPart(Part):
    """An image delivery: `rtp: HOST:PORT`, `zmq: tcp://HOST:PORT` or `v4l2: /dev/videoN`.

    sensor: the camera; optional where there is only one. of: the image that a vehicle perceives
    (mixed, in mode wil), or the unmixed one of real or twin. vehicle: whose perception; by default
    that of the judged one. rtp: send H.264 by RTP to this HOST:PORT; the port is even. zmq: publish
    by ZeroMQ at this address to bind. v4l2: write to this video loopback device. encoding: how zmq
    encodes the images. topic: the topic under which zmq publishes the images. key_interval_s:
    longest time between two key frames of rtp. max_bit_rate: the highest bit rate of rtp, in bits
    per second; by default not limited.
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


class _ToVehicles(Part):
    """An injection's vehicles and rate.

    to: the vehicles whose autopilots receive it; by default all. rate_hz: highest rate, up to 250;
    by default the usual one of the message.
    """

    to: Annotated[list[Side], Field(min_length=1)] = Field(default_factory=lambda: [*SIDES])
    rate_hz: RateHz | None = None

    @field_validator("to")
    @classmethod
    def _once_each(cls, to: list[Side]) -> list[Side]:
        """Refuse an injection that names a vehicle twice."""
        if len(set(to)) != len(to):
            raise ValueError("names a vehicle twice")
        return to


class OfSensorPart(_ToVehicles):
    """An injection made of a sensor's mixed readings.

    sensor: the recipe's name of the sensor whose mixed readings are sent.
    """

    sensor: Annotated[str, Field(min_length=1)]


class OfObjectsPart(_ToVehicles):
    """An injection made of the places of several objects of the virtual world.

    objects: their names in the world file.
    """

    objects: Annotated[list[str], Field(min_length=1)]


class OfObjectPart(_ToVehicles):
    """An injection made of the place of one object of the virtual world.

    object: its name in the world file.
    """

    object: Annotated[str, Field(min_length=1)]


class OfPosePart(_ToVehicles):
    """An injected pose: motion capture as it arrives, or a mixed sensor of type pose.

    sensor: the recipe's name of a mixed sensor of type pose; by default motion capture as it
    arrives.
    """

    sensor: Annotated[str, Field(min_length=1)] | None = None


class InjectPart(Part):
    """The campaign's `inject`: deliveries to autopilots by the name of the MAVLink message."""

    obstacle_distance: OfSensorPart | None = None
    distance_sensor: OfSensorPart | None = None
    adsb_vehicle: OfObjectsPart | None = None
    landing_target: OfObjectPart | None = None
    vision_position_estimate: OfPosePart | None = None
    odometry: OfPosePart | None = None

    @model_validator(mode="after")
    def _one_estimate(self) -> Self:
        """Refuse two delivered pose estimates (vision position and odometry)."""
        if self.vision_position_estimate is not None and self.odometry is not None:
            raise KeyFaultError("odometry", "vision_position_estimate delivers the pose already")
        return self

    def setups(self) -> tuple[InjectionSetup, ...]:
        """Return the injections to deliver, in the order of the messages above."""
        found: list[InjectionSetup] = []
        for thing in type(self).model_fields:
            part: _ToVehicles | None = getattr(self, thing)
            if part is None:
                continue
            objects: tuple[str, ...] = ()
            if isinstance(part, OfObjectsPart):
                objects = tuple(part.objects)
            elif isinstance(part, OfObjectPart):
                objects = (part.object,)
            found.append(
                InjectionSetup(
                    thing=thing,  # type: ignore[arg-type]  # the fields are its values
                    to=tuple(part.to),
                    sensor=part.sensor if isinstance(part, OfSensorPart | OfPosePart) else None,
                    objects=objects,
                    rate_hz=part.rate_hz,
                )
            )
        return tuple(found)


def ground_station_link(link: str) -> str:
    """Return a link that can lead to a ground station. Raises ValueError."""
    try:
        address = parse_link(link)
    except LinkAddressError as error:
        raise ValueError(f"is not a link: {error}") from error
    if address.kind not in {"udpout", "tcpout"}:
        raise ValueError("must be outgoing: udpout://HOST:14550 or tcpout://HOST:PORT")
    return link
