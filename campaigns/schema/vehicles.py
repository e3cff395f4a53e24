"""`vehicles`: the real vehicle and its twin."""

import math
from collections.abc import Callable, Sequence
from functools import reduce
from operator import or_
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import AfterValidator, BeforeValidator, Field, JsonValue, model_validator
from pydantic_core import PydanticKnownError

from wil_campaign.campaigns.schema.sensors import SensorPart
from wil_campaign.campaigns.schema.sources import MocapPart
from wil_campaign.campaigns.values.external_setups import PoseAccuracy, PoseSource
from wil_campaign.foundation.files.documents import KeyFaultError, LaterType, Part
from wil_campaign.hooks import autopilots, drivers, launches, link_layers
from wil_campaign.installed_plugins import (
    NamedAddition,
    absent_additions,
    loaded_additions,
    plugin_additions,
)
from wil_campaign.safety.fence.geographic import FARTHEST_M
from wil_campaign.vehicles.command_backends import OWN_FRAMES
from wil_campaign.vehicles.coupling import Coupling
from wil_campaign.vehicles.embedded.physics.config import Physics
from wil_campaign.vehicles.launch import LaunchPart, Pace, Text
from wil_campaign.vehicles.links.link_conditions import SIGNING, SPARE_LINKS
from wil_campaign.vehicles.links.link_strings import LinkAddressError, parse_link
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.scene.parts import BoxShape
from wil_campaign.worlds.world_file.world_schema import Coordinate

VehicleName = Literal["real", "twin"]
VEHICLES: tuple[VehicleName, ...] = get_args(VehicleName)

Hook = Callable[[], Sequence[NamedAddition]]
Distance = Annotated[float, Field(ge=-FARTHEST_M, le=FARTHEST_M)]
"""As far as fences on Earth may be; a plane through the origin is 780 m high there."""
ParameterName = Annotated[str, Field(pattern=r"^[A-Z0-9_]{1,16}$")]
"""MAVLink's param_id has 16 characters."""


def _known(hook: Hook, own: Sequence[str]) -> list[str]:
    return [*own, *plugin_additions(hook)]


def _one_of(hook: Hook, *own: str) -> Callable[[str], str]:
    """Return what refuses a name that no plugin adds by a hook. own: names of the core."""

    def check(name: str) -> str:
        if why := absent_additions(hook).get(name):
            raise ValueError(why)
        if name not in (known := _known(hook, own)):
            raise PydanticKnownError("literal_error", {"expected": " or ".join(map(repr, known))})
        return name

    return check


def _enum_of(hook: Hook, *own: str) -> Callable[[dict[str, JsonValue]], None]:
    """Return what lists such names in a JSON Schema."""
    return lambda schema: schema.update(enum=[*_known(hook, own)])


DriverName = Annotated[
    str,
    AfterValidator(_one_of(drivers, OWN_FRAMES)),
    Field(json_schema_extra=_enum_of(drivers, OWN_FRAMES)),
]
AutopilotName = Annotated[
    str, AfterValidator(_one_of(autopilots)), Field(json_schema_extra=_enum_of(autopilots))
]
Speedup = Pace
EMBEDDED_GPS = "the embedded vehicle flies by GPS; remove it"


class StartPart(Part):
    """A vehicle's `start` pose in the world before takeoff; yaw_deg clockwise from north.

    north_m, east_m, up_m: where the vehicle stands, in the world's local frame. yaw_deg: where its
    nose points, clockwise from north.
    """

    north_m: Distance = 0.0
    east_m: Distance = 0.0
    up_m: Coordinate = 0.0
    yaw_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0

    def pose(self) -> Pose:
        """Return the vehicle's start pose in the world's local frame."""
        yaw_rad = math.radians(self.yaw_deg)
        return Pose.of(self.north_m, self.east_m, self.up_m, yaw_rad=yaw_rad)


class PoseAccuracyPart(Part):
    """The accuracy of a vehicle's pose source, one standard deviation.

    velocity_m_s: of an estimate's own velocity; for motion capture it is derived from positions.
    position_m: standard deviation of each axis of the position. attitude_deg: standard deviation of
    each angle of the attitude.
    """

    position_m: Annotated[float, Field(ge=0, le=1000)]
    attitude_deg: Annotated[float, Field(ge=0, le=180)]
    velocity_m_s: Annotated[float, Field(gt=0, le=100)] | None = None

    def setup(self, usual: PoseAccuracy) -> PoseAccuracy:
        """Return the accuracy of the vehicle's pose source as runs use it; `usual`: its default."""
        return PoseAccuracy(
            position_m=self.position_m,
            attitude_rad=math.radians(self.attitude_deg),
            velocity_m_s=self.velocity_m_s or usual.velocity_m_s,
        )


class BodyPart(Part):
    """A vehicle's body by which contacts, clearances and gates are judged: a box round its middle.

    width_m: across and along, propellers included. height_m: from the feet to the top.
    """

    width_m: Annotated[float, Field(gt=0, le=20)]
    height_m: Annotated[float, Field(gt=0, le=20)]

    def shape(self) -> BoxShape:
        """Return the body's box, half extents forward, right, down."""
        return BoxShape((self.width_m / 2.0, self.width_m / 2.0, self.height_m / 2.0))


def require_vehicle_link(text: str) -> str:
    """Refuse a text that is no link address of an external vehicle."""
    if text == "embedded":
        return text
    try:
        address = parse_link(text)
    except LinkAddressError as error:
        raise ValueError(f"must be embedded, a link, or a launch: {error}") from error
    if address.kind == "memory":
        raise ValueError("memory:// connects to nothing outside this program; write embedded")
    return text


def _spare(text: str) -> str:
    """Refuse a text that is no address of a vehicle's spare link."""
    if why := absent_additions(link_layers).get(SPARE_LINKS):
        raise ValueError(why)
    if text == "embedded":
        raise ValueError("must be a link; the embedded vehicle has its own")
    return require_vehicle_link(text)


def _any_launch() -> Any:
    parts = [part for _, part in sorted(loaded_additions(launches, "part").items())]
    if len(parts) < 2:
        return parts[0] if parts else LaunchPart
    either: Any = reduce(or_, parts)
    return Annotated[either, Field(discriminator="launch")]


def _launchable(value: JsonValue) -> JsonValue:
    """Refuse a launch whose plugin is not installed."""
    name = value.get("launch") if isinstance(value, dict) else None
    if isinstance(name, str) and name not in plugin_additions(launches):
        if why := absent_additions(launches).get(name):
            raise ValueError(why)
        if not plugin_additions(launches):
            raise ValueError("no plugin launches a simulation")
    return value


AnyLaunch = Annotated[LaunchPart, LaterType(_any_launch), BeforeValidator(_launchable)]
"""The launch of any autopilot's simulation; `launch` selects the model."""


class SigningPart(Part):
    """A vehicle's MAVLink 2 signing key: in a `file`, or in an `environment` variable.

    file: one beside the campaign with the key: 32 bytes, 64 hexadecimal digits, base64 of 32 bytes,
    or passphrase:WORDS. environment: the name of an environment variable that holds the key.
    """

    file: Text | None = None
    environment: Text | None = None

    @model_validator(mode="after")
    def _require_exactly_one(self) -> Self:
        """Require one place of a vehicle's signing key: file or environment; and its plugin."""
        if why := absent_additions(link_layers).get(SIGNING):
            raise ValueError(why)
        if (self.file is None) == (self.environment is None):
            raise ValueError("give a file, or the name of an environment variable")
        return self


class TelemetryPart(Part):
    """A vehicle's `telemetry`: rates of positions, and the capacity of its radio.

    bandwidth_kbit_s: both ways together; by default that of the serial port. max_gap_s: the longest
    gap between positions with which a run is valid; by default three of their periods. rate_hz:
    requested rate of positions, from 10 to 100.
    """

    rate_hz: Annotated[float, Field(ge=10, le=100)] = 50.0
    bandwidth_kbit_s: Annotated[float, Field(gt=0, le=1e6)] | None = None
    max_gap_s: Annotated[float, Field(gt=0, le=60)] | None = None


class VehiclePart(Part):
    """One vehicle of the pair in a campaign file.

    link: embedded (the built-in simulation), a link such as udpin://0.0.0.0:14550, or the
    simulation to launch. autopilot: the firmware of the vehicle. profile: of an embedded vehicle:
    air, motors, battery, estimator, camera. physics: what moves an embedded vehicle: JSBSim, or
    a compiled rigid body that flies as JSBSim does, for less of the processor. params:
    autopilot parameters that are set before arming, and read back. pose_source: where the poses
    for judging and rendering come from: the simulator's ground truth (by default of a launched
    vehicle, and of an attached simulation that offers it when a campaign begins), motion
    capture, or the vehicle's own estimate (by default of others). sensors: by the names that
    the recipe uses. driver: what sends commands: mavlink (built in), or mavsdk in a separate
    process. system_id: of MAVLink; by default 1 for the real vehicle and 2 for the twin.
    anchor: what defines the place before arming: `start`, or motion capture. mocap: the source
    of motion capture; null: the embedded vehicle's. spare_links: further links to the same
    vehicle, used when those before them fall silent. coupling: of the twin, how it follows the
    real vehicle in mode wil. body: the one by which the vehicle is judged; by default that of
    the embedded vehicle. permit_dead_reckoning: whether the flight goes on, with a caveat,
    where the estimator loses what held its position at arming. gps: false of a vehicle that flies
    without: its estimator gets the world's origin where it has none, until it reboots.
    """

    link: Annotated[str, AfterValidator(require_vehicle_link)] | AnyLaunch
    spare_links: list[Annotated[str, AfterValidator(_spare)]] = Field(default_factory=list)
    autopilot: AutopilotName
    driver: DriverName = OWN_FRAMES
    system_id: Annotated[int, Field(ge=1, le=250)] | None = None
    signing: SigningPart | None = None
    telemetry: TelemetryPart = TelemetryPart()
    profile: Text = "nominal"
    physics: Physics = "jsbsim"
    params: dict[ParameterName, float] = Field(default_factory=dict)
    start: StartPart = StartPart()
    anchor: Literal["start", "mocap"] = "start"
    pose_source: PoseSource | None = None
    mocap: MocapPart | None = None
    pose_accuracy: PoseAccuracyPart | None = None
    body: BodyPart | None = None
    sensors: dict[str, SensorPart] = Field(default_factory=dict)
    coupling: Coupling = "follow"
    permit_dead_reckoning: bool = False
    gps: bool = True

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if self.link == "embedded":
            self._refuse_of_embedded()
        if self.mocap is not None and self.pose_source != "mocap":
            raise KeyFaultError("mocap", f"is not used with pose_source: {self.poses_from}")
        accuracy = self.pose_accuracy
        if accuracy is not None and accuracy.velocity_m_s and self.pose_source == "mocap":
            message = "applies to an estimate; motion capture has positions only: remove it"
            raise KeyFaultError(("pose_accuracy", "velocity_m_s"), message)
        if self.link != "embedded" and self.pose_source == "mocap" and self.mocap is None:
            raise KeyFaultError("pose_source", self._without_mocap())
        for name, sensor in self.sensors.items():
            captured = sensor.type == "pose" and self.pose_source == "mocap"
            given = captured or getattr(sensor, "source", None) is not None
            if self.link != "embedded" and sensor.embedded_only and not given:
                message = (
                    f"only the embedded vehicle's {sensor.type} is modelled; give the source of "
                    "its readings by `source`, or remove the sensor"
                )
                raise KeyFaultError(("sensors", name, "type"), message)
        if self.anchor == "mocap" and self.pose_source != "mocap":
            raise KeyFaultError("anchor", "uses motion capture: it needs pose_source: mocap")
        if self.spare_links and (not isinstance(self.link, str) or self.link == "embedded"):
            raise KeyFaultError("spare_links", "only a vehicle with its own link can have more")
        launched = None if isinstance(self.link, str) else self.link.launch
        if launched not in {None, self.autopilot}:
            raise KeyFaultError("autopilot", f"the link launches {launched}")
        return self

    def _refuse_of_embedded(self) -> None:
        if self.signing is not None:
            raise KeyFaultError("signing", "the embedded vehicle does not sign")
        if not self.gps:
            raise KeyFaultError("gps", EMBEDDED_GPS)

    def _without_mocap(self) -> str:
        """Return why a vehicle has no motion capture, and what to write instead."""
        instead = (
            "give its source by `mocap`, or write simulator (a simulation's ground truth) or "
            "mavlink (its estimate)"
            if isinstance(self.link, str)
            else "a launched simulation is judged by its ground truth: write simulator"
        )
        return f"only the embedded vehicle has built-in motion capture; {instead}"

    @property
    def poses_from(self) -> PoseSource:
        """Return the vehicle's pose source: as given, or the default of its kind of link."""
        if self.pose_source is not None:
            return self.pose_source
        return "mavlink" if isinstance(self.link, str) else "simulator"

    @property
    def leaves_poses_open(self) -> bool:
        """Return whether it is attached and has no pose source: what it offers decides, in `run`.

        It may be hardware, so that the file alone means its estimate.
        """
        is_attached = isinstance(self.link, str) and self.link != "embedded"
        return is_attached and self.pose_source is None


class VehiclesPart(Part):
    """The campaign's `vehicles`: the pair; a mode needs only those that it flies."""

    real: VehiclePart | None = None
    twin: VehiclePart | None = None

    @model_validator(mode="after")
    def _coupled(self) -> Self:
        if self.real is not None and "coupling" in self.real.model_fields_set:
            raise KeyFaultError(("real", "coupling"), "is a key of the twin; move it there")
        return self
