"""Setups of external I/O: sources of readings, motion capture, image outlets, injections."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from recipes.working import Side

SourceKind = Literal["rtsp", "rtp", "v4l2", "simulator", "mcap", "images", "video"]
ShownAs = Literal["live", "rendered", "file"]
_FILES: frozenset[SourceKind] = frozenset({"mcap", "images", "video"})


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceSetup:
    """An external source of a camera's images, which are then not rendered here.

    address: in the form of its kind; an absolute path for files. latency_s: middle of the exposure
    to arrival. open_s, stall_s: how long to wait for the first and each further image.
    answer_s: how long a simulator may take. topic: of an MCAP file. transport: of RTSP.
    device_format: of V4L2 ("mjpeg").
    """

    kind: SourceKind
    address: str
    latency_s: float = 0.0
    open_s: float = 5.0
    stall_s: float = 1.0
    answer_s: float = 0.2
    topic: str | None = None
    transport: Literal["tcp", "udp"] = "tcp"
    device_format: str | None = None

    @property
    def needs_wall_clock(self) -> bool:
        """Return whether the source runs in real time: only files play at any pace."""
        return self.kind not in _FILES

    @property
    def renders_on_request(self) -> bool:
        """Return whether the external source renders any requested pose, as our renderer does."""
        return self.kind == "simulator"

    @property
    def shown_as(self) -> ShownAs:
        """Return the external source's name in results."""
        if self.kind in _FILES:
            return "file"
        return "rendered" if self.renders_on_request else "live"


ReadingSourceKind = Literal["mavlink", "zmq", "mcap"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadingSourceSetup:
    """An external source of another sensor's readings, which are then not computed here.

    address: `mavlink`, tcp://HOST:PORT of a ZeroMQ publisher, or an absolute path. message: of
    MAVLink, its name; None for the estimate. sensor_id: of MAVLink's sensors; None: any.
    undulation_m: of the geoid above the ellipsoid. name: of the sensor in ZeroMQ messages. topic:
    prefix of ZeroMQ messages, or of an MCAP file. latency_s: sampling to arrival of the quickest.
    open_s, stall_s: how long to wait for the first and each further reading.
    """

    kind: ReadingSourceKind
    address: str
    message: str | None = None
    sensor_id: int | None = None
    undulation_m: float | None = None
    name: str = ""
    topic: str | None = None
    latency_s: float = 0.0
    open_s: float = 5.0
    stall_s: float = 1.0

    @property
    def needs_wall_clock(self) -> bool:
        """Return whether the source runs in real time: a socket other than the vehicle's link."""
        return self.kind == "zmq"

    @property
    def shown_as(self) -> ShownAs:
        """Return the external source's name in results."""
        return "file" if self.kind == "mcap" else "live"


@dataclass(frozen=True, slots=True, kw_only=True)
class MocapSetup:
    """External motion capture of one vehicle.

    kind, host, port: UDP to bind, ZeroMQ to connect to, or VRPN's server. body: its name there.
    latency_s: sampling to arrival of the quickest. stall_s: time without a pose in flight after
    which the run is INVALID. topic: prefix of ZeroMQ messages.
    """

    kind: Literal["udp", "zmq", "vrpn"]
    host: str
    port: int
    body: str
    latency_s: float = 0.0
    stall_s: float = 0.5
    topic: str = ""

    @property
    def address(self) -> str:
        """Return the external motion capture's address as the campaign writes it."""
        scheme = "tcp" if self.kind == "zmq" else self.kind
        return f"{scheme}://{self.host}:{self.port}"


PoseSource = Literal["simulator", "mocap", "mavlink"]
"""The source of a vehicle's pose: its simulator, motion capture, or the autopilot's estimate."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseAccuracy:
    """The accuracy of a pose source, one standard deviation: metres on each axis, and radians.

    velocity_m_s: of its velocity, each axis; None where that is derived from positions.
    """

    position_m: float
    attitude_rad: float
    velocity_m_s: float | None = None


CAPTURED = PoseAccuracy(position_m=0.002, attitude_rad=math.radians(0.5))
"""Optical motion capture (Vicon: millimetres; a millimetre over markers 0.1 m apart: 0.5 deg)."""
SIMULATED = PoseAccuracy(position_m=0.02, attitude_rad=math.radians(0.5), velocity_m_s=0.05)
"""A simulator's ground truth over MAVLink: a grid of 1.1 cm and, on PX4, 1 cm/s; without a time
stamp its time is known to some 10 ms, at 1 m/s and 1 rad/s."""
ESTIMATED = PoseAccuracy(position_m=1.0, attitude_rad=math.radians(2.0), velocity_m_s=0.1)
"""An autopilot's estimate by satellites and magnetometer; velocity: twice the 0.05 m/s of a u-blox
M8 receiver (its data sheet, velocity accuracy)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageOutlet:
    """An external outlet for the images of one camera.

    of: the image that a vehicle perceives, or the unmixed one of a vehicle. vehicle: whose; None:
    the judged one's. address: HOST:PORT, an endpoint to bind, or a device.
    """

    kind: Literal["rtp", "zmq", "v4l2"]
    address: str
    sensor: str
    of: Literal["perceived", "real", "twin"] = "perceived"
    vehicle: Side | None = None
    encoding: str = "bgr8"
    topic: str = "mixed"
    key_interval_s: float = 1.0
    max_bit_rate: int | None = None

    @property
    def name(self) -> str:
        """Return the outlet's name in messages ("rtp 127.0.0.1:5600")."""
        return f"{self.kind} {self.address}"


Injected = Literal[
    "obstacle_distance",
    "distance_sensor",
    "adsb_vehicle",
    "landing_target",
    "vision_position_estimate",
    "odometry",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class InjectionSetup:
    """An injection: a MAVLink message that is sent to the autopilots from outside.

    sensor: whose mixed readings it is made of; objects: whose places it is made of. to: the
    vehicles that receive it. rate_hz: None for the default of the autopilot.
    """

    thing: Injected
    to: tuple[Side, ...]
    sensor: str | None = None
    objects: tuple[str, ...] = ()
    rate_hz: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ExternalSetup:
    """All external I/O of a run.

    ground_station: link of a ground station that receives contacts, and RTP streams as a camera's.
    """

    outlets: tuple[ImageOutlet, ...] = ()
    injections: tuple[InjectionSetup, ...] = ()
    ground_station: str | None = None

    def needing_wall_clock(self) -> Iterator[tuple[tuple[str | int, ...], str]]:
        """Yield external I/O on sockets or devices: its path in the campaign, its name."""
        for index, outlet in enumerate(self.outlets):
            yield ("deliver", index), outlet.name
        if self.ground_station is not None:
            yield ("ground_station",), f"a ground station at {self.ground_station}"
