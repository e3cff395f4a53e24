"""`source` of a sensor and `mocap` of a vehicle: external inputs of a run."""

import re
from contextlib import suppress
from ipaddress import IPv4Address
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from wil_campaign.campaigns.values.external_setups import (
    OWN_SOURCES,
    MocapSetup,
    ReadingSourceSetup,
    SourceKind,
    SourceSetup,
)
from wil_campaign.campaigns.values.sensor_setups import OtherSensorSetup, SensorSetup, SourcedSetup
from wil_campaign.foundation.files.documents import KeyFaultError, Part
from wil_campaign.foundation.files.paths import is_folder, path_exists
from wil_campaign.hooks import image_sources, motion_captures, sources
from wil_campaign.installed_plugins import absent_additions, load_plugin_object, plugin_additions
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.sensors.sensor_spec import SensorOptions
from wil_campaign.vehicles.sources.readings.mavlink_messages import (
    mavlink_reading,
    messages_of_sensor,
)

Milliseconds = Annotated[float, Field(ge=0, le=10_000)]
Seconds = Annotated[float, Field(gt=0, le=600)]

_SCHEMES: dict[str, SourceKind] = {
    "rtsp://": "rtsp",
    "rtsps://": "rtsp",
    "rtp://": "rtp",
    "tcp://": "simulator",
    "ipc://": "simulator",
    "v4l2://": "v4l2",
    "/dev/": "v4l2",
}
_SHAPES: dict[SourceKind, tuple[str, str]] = {
    "rtsp": (r"rtsps?://([^/\s]+@)?[^/@\s]+(/\S*)?", "rtsp://HOST/PATH"),
    "rtp": (r"rtp://[^:/@\s]+:(?P<port>\d{1,5})/?", "rtp://HOST:PORT, as in rtp://0.0.0.0:5600"),
    "v4l2": (r"(v4l2://)?/dev/[^\s/]+(/[^\s/]+)*", "/dev/videoN"),
    "simulator": (r"tcp://[^/\s]+:(?P<port>\d{1,5})|ipc://\S+", "tcp://HOST:PORT, or ipc://PATH"),
}
"""The addresses of a kind of source, and how they are told."""
_ONLY_FOR: dict[str, tuple[SourceKind, ...]] = {
    "transport": ("rtsp",),
    "format": ("v4l2",),
    "topic": ("mcap",),
    "latency_ms": ("rtsp", "rtp", "v4l2", "images", "video", "mcap"),
    "answer_ms": ("simulator",),
    "stall_s": ("rtsp", "rtp", "v4l2"),
    "open_s": ("rtsp", "rtp", "v4l2", "simulator"),
}
"""The kinds of source on which a key has an effect."""


class SourcePart(Part):
    """A camera's external source of images; a bare text is the same as `address`.

    address: rtsp://..., rtp://HOST:PORT or FILE.sdp, /dev/videoN, a video file, a folder of images,
    an MCAP file, or tcp://HOST:PORT of a simulator. latency_ms: middle of the exposure to arrival.
    answer_ms: how long a simulator may take for an image. open_s: how long opening it may take.
    stall_s: time without an image in flight after which the run is INVALID. transport: how RTSP
    carries its packets. format: the pixel format that is requested from a video device, such as
    mjpeg. topic: the topic of the images in an MCAP file.
    """

    shorthand: ClassVar[str] = "address"
    address: Annotated[str, Field(min_length=1)]
    latency_ms: Milliseconds | None = None
    open_s: Seconds = 5.0
    stall_s: Seconds = 1.0
    answer_ms: Annotated[float, Field(gt=0, le=10_000)] = 200.0
    transport: Literal["tcp", "udp"] = "tcp"
    format: Annotated[str, Field(min_length=1)] | None = None
    topic: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _shorthand(cls, given: Any) -> Any:
        return {cls.shorthand: given} if isinstance(given, str) else given

    @model_validator(mode="after")
    def _require_fitting_keys(self) -> "SourcePart":
        if re.match(r"[A-Za-z0-9+]+://", self.address) and self._scheme() is None:
            known = ", ".join(scheme for scheme in _SCHEMES if scheme.endswith("://"))
            raise KeyFaultError(
                "address", f"'{self.address}': the known schemes are {known}, and files"
            )
        if (kind := self._scheme()) is not None:  # a file's is known only when its folder is
            self._require_shape(kind)
            self._require_effect(kind)
        return self

    def _require_shape(self, kind: SourceKind) -> None:
        """Refuse an address that no image source of a kind has. Raises KeyFaultError."""
        if self.address.endswith(".sdp"):
            return
        pattern, shape = _SHAPES[kind]
        match = re.fullmatch(pattern, self.address)
        port = None if match is None else match.groupdict().get("port")
        if match is None or (port is not None and not 0 < int(port) < 65536):
            raise KeyFaultError("address", f"'{self.address}' is not {shape}")

    def _require_effect(self, kind: SourceKind) -> None:
        """Refuse keys without effect on a kind of image source. Raises KeyFaultError."""
        for key, kinds in _ONLY_FOR.items():
            if key in self.model_fields_set and kind not in kinds:
                raise KeyFaultError(key, f"has no effect on a source of {kind}")

    def setup(self, folder: Path, *, latency_s: float) -> SourceSetup:
        """Return the setup of an external source; its files are relative to a folder.

        latency_s: of the calibration, where none is given here. Raises KeyFaultError for a missing
        file, a key without effect, and a kind of source whose plugin is not installed.
        """
        kind, address = self._scheme(), self.address
        if kind is None or address.endswith(".sdp"):
            kind, address = _file(folder, address)
            self._require_effect(kind)
        if kind in (missing := absent_additions(image_sources)):
            raise KeyFaultError("address", missing[kind])
        return SourceSetup(
            kind=kind,
            address=address,
            latency_s=latency_s if self.latency_ms is None else self.latency_ms / 1000.0,
            open_s=self.open_s,
            stall_s=self.stall_s,
            answer_s=self.answer_ms / 1000.0,
            topic=self.topic,
            transport=self.transport,
            device_format=self.format,
        )

    def _scheme(self) -> SourceKind | None:
        found = (kind for start, kind in _SCHEMES.items() if self.address.startswith(start))
        return next(found, "rtp" if self.address.endswith(".sdp") else None)


def _file(folder: Path, name: str) -> tuple[SourceKind, str]:
    """Return kind and path of an image source's file. Raises KeyFaultError if it is missing."""
    path = (folder / name).resolve()
    if not path_exists(path):
        raise KeyFaultError("address", f"there is no file or folder '{name}' beside the campaign")
    if path.suffix == ".sdp":
        return "rtp", str(path)
    if is_folder(path):
        return "images", str(path)
    return ("mcap" if path.suffix == ".mcap" else "video"), str(path)


_ONLY_FOR_READINGS: dict[str, tuple[str, ...]] = {
    "message": ("mavlink",),
    "id": ("mavlink",),
    "undulation_m": ("mavlink",),
    "name": ("zmq",),
    "topic": ("zmq", "mcap"),
    "latency_ms": ("zmq", "mcap"),
    "open_s": ("mavlink", "zmq"),
    "stall_s": ("mavlink", "zmq"),
}


class ReadingSourcePart(Part):
    """A sensor's external source of readings; a bare text is the same as `address`.

    address: mavlink (messages on the vehicle's link), tcp://HOST:PORT (a ZeroMQ publisher's), or an
    MCAP file. message: the MAVLink message, where several have such readings. id: of the vehicle's
    sensor, by the message's id. undulation_m: height of the geoid above the ellipsoid, for a GPS
    receiver that does not report it. name: the sensor's name in ZeroMQ messages; by default its
    name here. topic: the topic of a ZeroMQ publisher, or of an MCAP file. latency_ms: sampling to
    arrival. open_s: how long the first reading may take. stall_s: time without a reading in flight
    after which the run is INVALID.
    """

    shorthand: ClassVar[str] = "address"
    address: Annotated[str, Field(min_length=1)]
    message: str | None = None
    id: Annotated[int, Field(ge=0, le=255)] | None = None
    undulation_m: Annotated[float, Field(ge=-150, le=150)] | None = None
    name: Annotated[str, Field(min_length=1)] | None = None
    topic: str | None = None
    latency_ms: Milliseconds = 0.0
    open_s: Seconds = 5.0
    stall_s: Seconds = 1.0

    @model_validator(mode="before")
    @classmethod
    def _shorthand(cls, given: Any) -> Any:
        """Accept a bare text as the address of the source of readings."""
        return {cls.shorthand: given} if isinstance(given, str) else given

    @model_validator(mode="after")
    def _require_fitting_keys(self) -> "ReadingSourcePart":
        """Refuse an unknown address, and keys without effect on this kind of source."""
        kind = self.kind
        for key, kinds in _ONLY_FOR_READINGS.items():
            # A plugin's source gets what is in every SourceRequest.
            has_effect = kind in kinds or ("zmq" in kinds and kind not in OWN_SOURCES)
            if key in self.model_fields_set and not has_effect:
                raise KeyFaultError(key, f"has no effect on a source of {kind}")
        return self

    @property
    def kind(self) -> str:
        """Return the kind of source that the address names. Raises KeyFaultError."""
        if self.address == "mavlink":
            return "mavlink"
        of_plugins = {
            name: sensor_source
            for name, sensor_source in plugin_additions(sources).items()
            if name not in OWN_SOURCES
        }
        match = re.fullmatch(r"tcp://[^:/@\s]+:(\d{1,5})", self.address)
        if match is not None and 0 < int(match[1]) < 65536:
            return _installed_kind("zmq")
        if self.address.endswith(".mcap") and "://" not in self.address:
            return _installed_kind("mcap")
        scheme, is_scheme, _ = self.address.partition("://")
        if is_scheme and scheme in {*of_plugins, *absent_additions(sources)}:
            return _installed_kind(scheme)
        fault = "must be mavlink, tcp://HOST:PORT (a ZeroMQ publisher), or an MCAP file (.mcap)"
        fault += "".join(f", or {source.addresses}" for source in of_plugins.values())
        raise KeyFaultError("address", f"'{self.address}' {fault}")

    def setup(self, folder: Path, *, sensor: str, message: str | None) -> ReadingSourceSetup:
        """Return the setup of a sensor's source; its file is relative to a folder.

        message: of MAVLink, with the default filled in. Raises KeyFaultError for a missing file.
        """
        kind, address = self.kind, self.address
        if kind == "mcap":
            _, address = _file(folder, address)
        return ReadingSourceSetup(
            kind=kind,
            address=address,
            message=message,
            sensor_id=self.id,
            undulation_m=self.undulation_m,
            name=self.name or sensor,
            topic=self.topic,
            latency_s=self.latency_ms / 1000.0,
            open_s=self.open_s,
            stall_s=self.stall_s,
        )


def _installed_kind(kind: str) -> str:
    """Return a kind of source of readings; raises KeyFaultError where its plugin is absent."""
    if why := absent_additions(sources).get(kind):
        raise KeyFaultError("address", why)
    return kind


class CarriedPart(Part):
    """Any sensor. embedded_only: without a source, only the embedded vehicle has its readings.

    type: the kind of sensor.
    """

    embedded_only: ClassVar[bool] = False
    type: str

    def setup(self, name: str) -> SensorSetup:
        """Return the setup of the sensor."""
        raise NotImplementedError


class SourcedPart(CarriedPart):
    """A sensor whose readings may be external.

    source: where its readings come from; by default they are computed from the vehicle's motion and
    the world.
    """

    source: ReadingSourcePart | None = None

    def setup(self, name: str) -> SourcedSetup:
        """Return the setup of the sensor, without its source."""
        if not isinstance(self, SensorOptions):
            raise TypeError(f"{type(self).__name__} has no options of a sensor")
        return OtherSensorSetup(kind=self.type, name=name, options=self)

    @model_validator(mode="after")
    def _require_fitting_source(self) -> Self:
        """Refuse what the plugin of the source finds wrong with its address for this type."""
        if self.source is not None and self.source.kind not in OWN_SOURCES:
            check = load_plugin_object(plugin_additions(sources)[self.source.kind].check)
            if fault := check(self.source.address, self.type):
                raise KeyFaultError(("source", "address"), fault)
        return self

    @model_validator(mode="after")
    def _require_fitting_message(self) -> Self:
        """Refuse a MAVLink message that has no readings of this type, or keys it does not know."""
        if self.source is None or self.source.kind != "mavlink":
            return self
        kind = self.type
        there, wanted = messages_of_sensor(kind), self.source.message
        if kind != "pose" and not there:
            fault = (
                f"MAVLink has no message with readings of type {kind}: use tcp:// or an MCAP file"
            )
            raise KeyFaultError(("source", "address"), fault)
        if wanted is not None and wanted not in there:
            known = ", ".join(there) or "none, for it is the vehicle's estimate"
            fault = f"'{wanted}' has no readings of type {kind}; known are: {known}"
            raise KeyFaultError(("source", "message"), fault)
        mount: Any = getattr(self, "mount", None)
        level = "" if (read := mavlink_reading(kind)) is None else read.level
        if level and (mount.roll_deg or mount.pitch_deg or mount.yaw_deg):
            raise KeyFaultError("mount", f"cannot be turned: {level}")
        for key, owner in (("id", "rangefinder"), ("undulation_m", "gps")):
            if key in self.source.model_fields_set and kind != owner:
                raise KeyFaultError(("source", key), f"applies to a {owner} only")
        return self

    def sourced_from(self, autopilot: str) -> str | None:
        """Return the MAVLink message of the sensor's source; None where it has none.

        Raises KeyFaultError for a message that this autopilot never sends, or without a known unit.
        """
        there = messages_of_sensor(self.type)
        if self.source is None or self.source.kind != "mavlink" or not there:
            return None
        given = self.source.message
        strategy = autopilot_named(autopilot)
        usual = strategy.imu_message if there[0] == "HIGHRES_IMU" else there[0]
        if fault := strategy.unsent_messages.get(usual):
            raise KeyFaultError(("source", "address"), fault)
        if given == "RAW_IMU" != strategy.imu_message:
            fault = (
                "MAVLink gives RAW_IMU no unit, and only ArduPilot's is known (milli-g and "
                "mrad/s): use HIGHRES_IMU or SCALED_IMU"
            )
            raise KeyFaultError(("source", "message"), fault)
        return given or usual


def _is_sender(text: str) -> bool:
    """Return whether a text is an IPv4 address, with or without a port."""
    host, has_port, port = text.partition(":")
    with suppress(ValueError):
        IPv4Address(host)
        return not has_port or (port.isascii() and port.isdigit() and 0 < int(port) < 65536)
    return False


class MocapPart(Part):
    """A vehicle's external source of motion capture; a bare text is the same as `address`.

    address: udp://HOST:PORT (ours, to bind), or tcp://HOST:PORT (a ZeroMQ publisher's). body: its
    name in the capture system; by default the vehicle's. stall_s: time without a pose in flight
    after which the run is INVALID. latency_ms: from the capture of a pose to its arrival. topic:
    the topic of a ZeroMQ publisher; by default all. sender: with udp://, the address whose messages
    are taken, IP or IP:PORT; by default that of the first, and the run is refused where a second
    one sends before arming.
    """

    shorthand: ClassVar[str] = "address"
    address: str
    body: Annotated[str, Field(min_length=1)] | None = None
    latency_ms: Milliseconds = 0.0
    stall_s: Seconds = 0.5
    topic: str = ""
    sender: str = ""

    @model_validator(mode="before")
    @classmethod
    def _shorthand(cls, given: Any) -> Any:
        """Accept a bare text as the address of the motion capture source."""
        return {cls.shorthand: given} if isinstance(given, str) else given

    @model_validator(mode="after")
    def _require_known_scheme(self) -> "MocapPart":
        """Refuse a motion capture source's address of an unknown scheme, or of an absent plugin."""
        kind, _, _ = self._parse_address()
        if why := absent_additions(motion_captures).get(kind):
            raise KeyFaultError("address", why)
        if self.topic and kind != "zmq":
            raise KeyFaultError("topic", "applies to tcp:// only")
        if self.sender and kind != "udp":
            raise KeyFaultError("sender", "applies to udp:// only: the others are connected to")
        if self.sender and not _is_sender(self.sender):
            raise KeyFaultError("sender", "must be an IP address, or IP:PORT (192.168.1.10:5000)")
        return self

    def setup(self, vehicle: str) -> MocapSetup:
        """Return the setup of a vehicle's motion capture source."""
        kind, host, port = self._parse_address()
        return MocapSetup(
            kind=kind,
            host=host,
            port=port,
            body=self.body or vehicle,
            latency_s=self.latency_ms / 1000.0,
            stall_s=self.stall_s,
            topic=self.topic,
            sender=self.sender,
        )

    def _parse_address(self) -> tuple[Literal["udp", "zmq"], str, int]:
        """Return kind, host and port of a motion capture source's address."""
        if self.address.startswith("vrpn://"):
            raise KeyFaultError(
                "address",
                "VRPN is not read any more: have a bridge of 20 lines send its poses "
                "(docs/motion-capture.md), and write udp://127.0.0.1:5570",
            )
        match = re.fullmatch(r"(udp|tcp)://([^:/@\s]+):(\d{1,5})", self.address)
        if match is None or not 0 < int(match[3]) < 65536:
            raise KeyFaultError(
                "address",
                "must be udp://HOST:PORT (to listen) or tcp://HOST:PORT (a ZeroMQ publisher)",
            )
        return "udp" if match[1] == "udp" else "zmq", match[2], int(match[3])
