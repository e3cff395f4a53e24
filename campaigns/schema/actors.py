"""`actors`: objects of the world, each flown by a vehicle of its own."""

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from wil_campaign.campaigns.schema.vehicles import (
    EMBEDDED_GPS,
    AnyLaunch,
    AutopilotName,
    ParameterName,
    SigningPart,
    StartPart,
    TelemetryPart,
    require_vehicle_link,
)
from wil_campaign.foundation.files.documents import KeyFaultError, Part
from wil_campaign.safety.fence.fence_schema import FencePart
from wil_campaign.vehicles.embedded.physics.config import Physics
from wil_campaign.vehicles.launch import Text

ActorPoses = Literal["simulator", "mavlink"]


class ActorFencePart(FencePart):
    """An actor's own `geofence`: where its vehicle may be, in the world in which its object is."""

    @model_validator(mode="after")
    def _without_file(self) -> Self:
        """Refuse the fence file of an actor."""
        if self.file is not None:
            raise KeyFaultError("file", "an actor's fence is written here; give a box or include")
        return self


class ElsewherePart(Part):
    """Where an attached actor flies while its object is virtual.

    place: where it stands instead of its object's start, in the real world's local frame; its path
    begins there.
    """

    place: StartPart


class ActorPart(Part):
    """A vehicle that flies as an object of the world, along the motion which that object has there.

    link: embedded, a link such as udpin://0.0.0.0:14560, or the simulation to launch. virtual: what
    flies where the object is virtual, for an attached vehicle, which is physical: an embedded
    vehicle, or itself at another place. autopilot: the firmware of the vehicle. profile: of an
    embedded vehicle: air, motors, battery, estimator. physics: what moves it. params: autopilot
    parameters that are set before arming, and read back. system_id: of MAVLink; from 3 on by
    default. signing: the source of the key of an attached vehicle. telemetry: rates of
    positions, and the capacity of its radio. pose_source: what moves the object: the
    simulator's ground truth (by default of a launched vehicle), or the vehicle's own estimate
    (by default of an attached one). geofence: where the vehicle may be; required for an
    attached one. max_offset_m: largest distance from its path, beyond which the run is INVALID.
    max_delay_s: how long before, at most, the motion was where it is: how late it left the
    ground, and how far it has fallen behind since. max_silence_s: longest time without a
    position. gps: as a vehicle's of the pair.
    """

    link: Annotated[str, AfterValidator(require_vehicle_link)] | AnyLaunch
    virtual: Literal["embedded"] | ElsewherePart | None = None
    autopilot: AutopilotName
    profile: Text = "nominal"
    physics: Physics = "jsbsim"
    params: dict[ParameterName, float] = Field(default_factory=dict)
    system_id: Annotated[int, Field(ge=1, le=250)] | None = None
    signing: SigningPart | None = None
    telemetry: TelemetryPart = TelemetryPart()
    pose_source: ActorPoses | None = None
    geofence: ActorFencePart | None = None
    max_offset_m: Annotated[float, Field(gt=0, le=100)] = 0.5
    max_delay_s: Annotated[float, Field(gt=0, le=600)] = 4.0
    max_silence_s: Annotated[float, Field(gt=0, le=3)] = 0.5
    gps: bool = True

    @model_validator(mode="after")
    def _possible(self) -> Self:
        """Refuse what an actor of this kind of link cannot have."""
        if not self.is_attached:
            for key in ("virtual", "signing"):
                if getattr(self, key) is not None:
                    raise KeyFaultError(key, "is for an attached actor only; remove it")
        elif self.geofence is None:
            message = "an attached actor may be hardware and needs a `geofence` of its own"
            raise KeyFaultError("link", message)
        if self.link == "embedded" and not self.gps:
            raise KeyFaultError("gps", EMBEDDED_GPS)
        if self.telemetry.max_gap_s is not None:
            message = "has no effect on an actor; write max_silence_s"
            raise KeyFaultError(("telemetry", "max_gap_s"), message)
        if self.link == "embedded" and self.pose_source == "mavlink":
            message = "an embedded actor always moves its object by its ground truth; remove it"
            raise KeyFaultError("pose_source", message)
        launched = None if isinstance(self.link, str) else self.link.launch
        if launched not in {None, self.autopilot}:
            raise KeyFaultError("autopilot", f"the link launches {launched}")
        return self

    @property
    def is_attached(self) -> bool:
        """Return whether the actor is neither embedded nor launched."""
        return isinstance(self.link, str) and self.link != "embedded"

    @property
    def poses_from(self) -> ActorPoses:
        """Return the pose source that moves the actor's object: as given, or the default."""
        return self.pose_source or ("mavlink" if self.is_attached else "simulator")
