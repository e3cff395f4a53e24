"""Setups of external I/O: sources of readings, motion capture."""

import math
from dataclasses import dataclass
from typing import Literal

from wil_campaign.hooks import sources
from wil_campaign.installed_plugins import plugin_additions

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


OWN_SOURCES = ("mavlink", "zmq", "mcap")
"""The kinds of sources of readings whose addresses have no scheme of their own; others are schemes.
MAVLink's messages are on the vehicle's link; plugins open all other sources."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadingSourceSetup:
    """An external source of another sensor's readings, which are then not computed here.

    kind: of OWN_SOURCES, or the scheme of a plugin's. address: `mavlink`, tcp://HOST:PORT of a
    ZeroMQ publisher, an absolute path, or an address of a plugin's scheme. message: of
    MAVLink, its name; None for the estimate. sensor_id: of MAVLink's sensors; None: any.
    undulation_m: of the geoid above the ellipsoid. name: of the sensor in ZeroMQ messages. topic:
    prefix of ZeroMQ messages, or of an MCAP file. latency_s: sampling to arrival of the quickest.
    open_s, stall_s: how long to wait for the first and each further reading.
    """

    kind: str
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
        """Return whether the source runs in real time, by another way than the vehicle's link."""
        return self.shown_as == "live" and self.kind != "mavlink"

    @property
    def shown_as(self) -> ShownAs:
        """Return the external source's name in results."""
        if self.kind == "mavlink":
            return "live"
        return "file" if plugin_additions(sources)[self.kind].is_file else "live"


@dataclass(frozen=True, slots=True, kw_only=True)
class MocapSetup:
    """External motion capture of one vehicle.

    kind, host, port: UDP to bind, or ZeroMQ to connect to. body: its name in the capture system.
    latency_s: sampling to arrival of the quickest. stall_s: time without a pose in flight after
    which the run is INVALID. topic: prefix of ZeroMQ messages. sender: whose UDP messages are
    taken, HOST or HOST:PORT; empty for the first.
    """

    kind: Literal["udp", "zmq"]
    host: str
    port: int
    body: str
    latency_s: float = 0.0
    stall_s: float = 0.5
    topic: str = ""
    sender: str = ""

    @property
    def address(self) -> str:
        """Return the external motion capture's address as the campaign writes it."""
        scheme = "tcp" if self.kind == "zmq" else "udp"
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
