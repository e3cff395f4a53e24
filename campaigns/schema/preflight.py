"""`preflight`: what is looked at and set before vehicles arm."""

from typing import Annotated, Literal

from pydantic import Field

from safety.preflight import Check
from worlds.files.documents import Part


class OwnFencePart(Part):
    """The preflight's `autopilot_fence`: uploaded from `geofence` and read back.

    margin_m: by how much it is wider, so that it acts where the guard did not.
    """

    margin_m: Annotated[float, Field(ge=0, le=1000)] = 1.0


class GpsCheckPart(Part):
    """The preflight's GPS check, for a vehicle whose poses are its own estimates.

    min_satellites, max_hdop: what both autopilots want by default (EKF2_REQ_NSATS; ArduPilot's
    GPS_HDOP_GOOD is stricter).
    """

    min_satellites: Annotated[int, Field(ge=0, le=100)] = 6
    max_hdop: Annotated[float, Field(gt=0, le=100)] = 2.5


class PreflightPart(Part):
    """The campaign's `preflight`: conditions that hold before vehicles arm.

    fence: null uploads none. failsafe: whether the parameters of the autopilot's own failsafes are
    set, or only checked; by default set for embedded and launched vehicles, checked for attached
    ones. min_battery: of the charge, 0 to 1. min_disk_mb: room for recordings. start_tolerance_m:
    how far from its start a vehicle may stand by its pose source; pair_tolerance_m: how differently
    real and twin may. gps: null looks at no receiver, for vehicles that fly by something else.
    min_mocap_hz: how often motion capture has to see a vehicle. max_clock_error_s: how uncertain a
    vehicle's clock may be. override: checks that do not count, each with who takes the
    responsibility.
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
