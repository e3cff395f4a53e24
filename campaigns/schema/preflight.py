"""`preflight`: conditions and settings that are checked before vehicles arm."""

from typing import Annotated, Literal

from pydantic import Field

from wil_campaign.foundation.files.documents import Part
from wil_campaign.safety.preflight import Check


class OwnFencePart(Part):
    """The fence of the autopilot: uploaded from `geofence` and read back.

    margin_m: by how much it is wider than the geofence, so that it acts only if the guard failed.
    """

    margin_m: Annotated[float, Field(ge=0, le=1000)] = 1.0


class GpsCheckPart(Part):
    """The preflight's GPS check, for a vehicle without motion capture.

    min_satellites, max_hdop: by default what both autopilots require (EKF2_REQ_NSATS; ArduPilot's
    GPS_HDOP_GOOD is stricter).
    """

    min_satellites: Annotated[int, Field(ge=0, le=100)] = 6
    max_hdop: Annotated[float, Field(gt=0, le=100)] = 2.5


class PreflightPart(Part):
    """The campaign's `preflight`: conditions that hold before vehicles arm.

    fence: the autopilot's own fence; null uploads none. failsafe: whether the parameters of the
    autopilot's own failsafes are set, or only checked; by default set for embedded and launched
    vehicles, checked for attached ones. min_battery: least charge, 0 to 1. min_disk_mb: free space
    for recordings. start_tolerance_m: largest distance of a vehicle from its start, by its pose
    source. pair_tolerance_m: largest difference between the offsets of real and twin from their
    starts. gps: null skips the check, for vehicles that fly without GPS. min_mocap_hz: least rate
    of motion capture. max_clock_error_s: largest uncertainty of a vehicle's clock. override: checks
    that are ignored, each with the name of the person who takes the responsibility.
    """

    fence: OwnFencePart | None = OwnFencePart()
    failsafe: Literal["set", "check"] | None = None
    min_battery: Annotated[float, Field(ge=0, le=1)] = 0.3
    min_disk_mb: Annotated[float, Field(ge=0)] = 200.0
    start_tolerance_m: Annotated[float, Field(gt=0, le=1000)] = 0.5
    pair_tolerance_m: Annotated[float, Field(gt=0, le=1000)] = 0.5
    gps: GpsCheckPart | None = GpsCheckPart()
    min_mocap_hz: Annotated[float, Field(ge=0, le=10_000)] = 10.0
    max_clock_error_s: Annotated[float, Field(gt=0, le=10)] = 0.25
    override: dict[Check, Annotated[str, Field(min_length=1)]] = Field(default_factory=dict)
