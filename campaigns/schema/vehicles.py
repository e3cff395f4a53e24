"""`vehicles`: the real vehicle and its twin."""

import math
from typing import Annotated, Literal, Self, get_args

from pydantic import Field, field_validator, model_validator

from campaigns.outside_setups import PoseAccuracy
from campaigns.schema.sensors import SensorPart
from campaigns.schema.sources import MocapPart
from vehicles.autopilots.base import AutopilotName
from vehicles.links.parse import LinkAddressError, parse_link
from worlds.documents import KeyFaultError, Part
from worlds.frames import Pose

VehicleName = Literal["real", "twin"]
VEHICLES: tuple[VehicleName, ...] = get_args(VehicleName)

ParameterName = Annotated[str, Field(pattern=r"^[A-Z0-9_]{1,16}$")]
"""MAVLink's param_id has 16 characters."""


class StartPart(Part):
    """Where in the world a vehicle stands before it takes off; yaw_deg clockwise from north."""

    north_m: float = 0.0
    east_m: float = 0.0
    up_m: float = 0.0
    yaw_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0

    def pose(self) -> Pose:
        """Return it in the world's local frame."""
        yaw_rad = math.radians(self.yaw_deg)
        return Pose.of(self.north_m, self.east_m, self.up_m, yaw_rad=yaw_rad)


class PoseAccuracyPart(Part):
    """How exact a pose source is, one standard deviation."""

    position_m: Annotated[float, Field(ge=0, le=1000)]
    attitude_deg: Annotated[float, Field(ge=0, le=180)]

    def setup(self) -> PoseAccuracy:
        """Return it as runs use it."""
        return PoseAccuracy(
            position_m=self.position_m, attitude_rad=math.radians(self.attitude_deg)
        )


class VehiclePart(Part):
    """One vehicle of the pair. mocap: where motion capture comes from; None: the surrogate's."""

    link: str
    autopilot: AutopilotName
    profile: Annotated[str, Field(min_length=1)] = "nominal"
    params: dict[ParameterName, float] = Field(default_factory=dict)
    start: StartPart = StartPart()
    anchor: Literal["start"] = "start"
    pose_source: Literal["mavlink", "mocap"] = "mavlink"
    mocap: MocapPart | None = None
    pose_accuracy: PoseAccuracyPart | None = None
    sensors: dict[str, SensorPart] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _mocap_is_used(self) -> Self:
        if self.mocap is not None and self.pose_source != "mocap":
            raise KeyFaultError("mocap", f"is not used with pose_source: {self.pose_source}")
        return self

    @field_validator("link")
    @classmethod
    def _embedded(cls, link: str) -> str:
        if link == "embedded":
            return link
        try:
            parse_link(link)
        except LinkAddressError as error:
            raise ValueError(f"must be embedded, or a link: {error}") from error
        raise ValueError("a vehicle attached by a link cannot be flown yet; only 'embedded' can")


class VehiclesPart(Part):
    """The pair; a mode that a vehicle does not fly in can do without it."""

    real: VehiclePart | None = None
    twin: VehiclePart | None = None
