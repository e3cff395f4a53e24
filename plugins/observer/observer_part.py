"""The campaign's `observer`: a fixed camera that looks at the world from outside."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Self

from pydantic import Field, ValidationError, model_validator

from wil_campaign.campaigns.expansion.expansion import Campaign
from wil_campaign.foundation.files.documents import Data, KeyFaultError, Part
from wil_campaign.worlds.camera import LEAST_FOV_DEG, Intrinsics
from wil_campaign.worlds.frames import Pose, Vec3, subtract

_NEAREST_M = 1e-3
Metres = Annotated[float, Field(ge=-10_000.0, le=10_000.0)]


@dataclass(frozen=True, slots=True)
class FixedObserver:
    """A fixed camera. pose: in the world (NED), FRD axes, x looks out. rate_hz: of its films."""

    pose: Pose
    intrinsics: Intrinsics
    rate_hz: float


class PlacePart(Part):
    """A place in the world: metres north, east and up of its origin.

    north_m, east_m, up_m: from the world's origin.
    """

    north_m: Metres = 0.0
    east_m: Metres = 0.0
    up_m: Metres = 0.0


class ObserverPart(Part):
    """The campaign's `observer`, a camera that stands in the world and is level.

    north_m, east_m, up_m: where it stands, from the world's origin. look_at: the place in the
    middle of its image. yaw_deg: instead of it, clockwise from north. pitch_deg: with yaw_deg,
    positive upwards.
    width_px, height_px: size of its images. fov_deg: horizontal field of view, from edge to edge.
    rate_hz: images in a second of its films.
    """

    north_m: Metres
    east_m: Metres
    up_m: Metres
    look_at: PlacePart | None = None
    yaw_deg: Annotated[float, Field(ge=-360.0, le=360.0)] | None = None
    pitch_deg: Annotated[float, Field(ge=-90.0, le=90.0)] = 0.0
    width_px: Annotated[int, Field(ge=16, le=4096)] = 640
    height_px: Annotated[int, Field(ge=16, le=4096)] = 480
    fov_deg: Annotated[float, Field(ge=LEAST_FOV_DEG, lt=180.0)] = 70.0
    rate_hz: Annotated[float, Field(gt=0.0, le=60.0)] = 10.0

    @model_validator(mode="after")
    def _one_direction(self) -> Self:
        """Require one way to state where the observer looks, and a place that is not its own."""
        if (self.look_at is None) == (self.yaw_deg is None):
            raise ValueError("an observer needs exactly one of 'look_at' and 'yaw_deg'")
        if self.look_at is not None:
            if "pitch_deg" in self.model_fields_set:
                raise KeyFaultError("pitch_deg", "look_at determines this already")
            if math.dist(self._place_ned_m(), _ned_m(self.look_at)) < _NEAREST_M:
                raise KeyFaultError("look_at", "the observer stands there itself")
        return self

    def observer(self) -> FixedObserver:
        """Return the camera."""
        place_m = self._place_ned_m()
        if self.look_at is not None:
            pose = pose_looking_at(place_m, _ned_m(self.look_at))
        else:
            turn = {"yaw_rad": self.yaw_deg or 0.0, "pitch_rad": self.pitch_deg}
            radians = {name: math.radians(value) for name, value in turn.items()}
            pose = Pose.of(self.north_m, self.east_m, self.up_m, **radians)
        intrinsics = Intrinsics.from_fov(self.width_px, self.height_px, math.radians(self.fov_deg))
        return FixedObserver(pose, intrinsics, self.rate_hz)

    def _place_ned_m(self) -> Vec3:
        return (self.north_m, self.east_m, -self.up_m)


def _ned_m(place: PlacePart) -> Vec3:
    return (place.north_m, place.east_m, -place.up_m)


def pose_looking_at(place_ned_m: Vec3, target_ned_m: Vec3) -> Pose:
    """Return the level pose (FRD axes) at a place whose x axis points to another one."""
    north_m, east_m, down_m = subtract(target_ned_m, place_ned_m)
    level_m = math.hypot(north_m, east_m)
    yaw_rad = math.atan2(east_m, north_m) if level_m > _NEAREST_M else 0.0
    pitch_rad = math.atan2(-down_m, level_m)
    n, e, d = place_ned_m
    return Pose.of(n, e, -d, yaw_rad=yaw_rad, pitch_rad=pitch_rad)


def check_observer(campaign: Campaign) -> None:
    """Check a campaign's observer beyond its schema: there is nothing more to know of it."""
    del campaign


def observer_in(document: Mapping[str, Data]) -> FixedObserver | None:
    """Return the observer of a campaign file as flown; None without one, or for a damaged one."""
    given = document.get("observer")
    if given is None:
        return None
    try:
        return ObserverPart.model_validate(given).observer()
    except ValidationError:
        return None
