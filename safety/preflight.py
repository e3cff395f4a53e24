"""Preflight: the checks before a vehicle arms; pure.

Each check gives an item for the result: ok, refused, or overridden with the name of a person.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.worlds.figures import distinct_value_text
from wil_campaign.worlds.frames import Vec3, norm, subtract

Check = Literal[
    "firmware",
    "failsafe",
    "return_altitude",
    "takeoff_height",
    "fence",
    "home",
    "battery",
    "estimator",
    "position",
    "gps",
    "mocap",
    "ground_truth",
    "clock",
    "pair",
    "separation",
    "distance",
    "disk",
    "operator",
    "sender",
]
_FIX_WITH_HEIGHT = 3
"""GPS_FIX_TYPE_3D_FIX; better fixes have greater numbers."""
_GPS_M = 5.0
"""The largest error of the distance of two vehicles: 2.5 m for each receiver, outdoors; of a place,
twice that of its receiver."""
_TURNED_DEG = 15.0
"""The largest error of a compass beside motors, and of who puts a vehicle down."""
_NO_RECEIVER = "it has no GPS receiver; say gps: false of a vehicle that flies without one"
_LEAST_TRUTH = 0.5
"""The least accepted part of the requested rate of a simulator's ground truth."""
Outcome = Literal["ok", "refused", "overridden"]


@dataclass(frozen=True, slots=True)
class PreflightItem:
    """A preflight check's item for one vehicle; vehicle: empty when it concerns all.

    actual, limit: the measured and the required value, in unit; None where it is no number. text:
    the reason; empty when it is ok. by: the person who is responsible for an override.
    """

    check: Check
    vehicle: str
    outcome: Outcome
    actual: float | None = None
    limit: float | None = None
    unit: str = ""
    text: str = ""
    by: str = ""

    def __str__(self) -> str:
        subject = f"{self.vehicle} " if self.vehicle else ""
        by = f" (overridden by {self.by})" if self.by else ""
        return f"{subject}{self.check}: {self.text or self.outcome}{by}"


def other_sender_item(vehicle: str, text: str) -> PreflightItem:
    """Return the preflight item of another sender with a vehicle's ids, which is ignored."""
    return PreflightItem("sender", vehicle, "ok", text=text)


def items_with_overrides(
    items: Iterable[PreflightItem], overrides: Mapping[Check, str]
) -> tuple[PreflightItem, ...]:
    """Return the preflight items, overridden ones marked so."""
    return tuple(
        replace(item, outcome="overridden", by=overrides[item.check])
        if item.outcome == "refused" and item.check in overrides
        else item
        for item in items
    )


def refused_items_text(items: Iterable[PreflightItem]) -> str:
    """Return the refused preflight items as one text; empty when there is none."""
    return "; ".join(str(item) for item in items if item.outcome == "refused")


def at_least_item(
    check: Check, vehicle: str, actual: float | None, limit: float, *, unit: str, what: str
) -> PreflightItem:
    """Return the preflight item of a value with a least limit; None is unknown."""
    if actual is None or not math.isfinite(actual):
        return PreflightItem(check, vehicle, "refused", None, limit, unit, f"{what} is not known")
    if actual < limit:
        text = f"{what} is {_beside(actual, limit, unit, 'at least')} is required"
        return PreflightItem(check, vehicle, "refused", actual, limit, unit, text)
    return PreflightItem(check, vehicle, "ok", actual, limit, unit)


def at_most_item(
    check: Check, vehicle: str, actual: float | None, limit: float, *, unit: str, what: str
) -> PreflightItem:
    """Return the preflight item of a value with a greatest limit; None is unknown."""
    if actual is None or not math.isfinite(actual):
        return PreflightItem(check, vehicle, "refused", None, limit, unit, f"{what} is not known")
    if actual > limit:
        text = f"{what} is {_beside(actual, limit, unit, 'at most')} is allowed"
        return PreflightItem(check, vehicle, "refused", actual, limit, unit, text)
    return PreflightItem(check, vehicle, "ok", actual, limit, unit)


def faults_item(check: Check, vehicle: str, faults: Iterable[str]) -> PreflightItem:
    """Return the preflight item of a list of faults; ok if it is empty."""
    text = "; ".join(faults)
    return PreflightItem(check, vehicle, "refused" if text else "ok", text=text)


def firmware_item(vehicle: str, flown: str, *, fits: bool, wanted: str) -> PreflightItem:
    """Return the preflight item of a vehicle's firmware. flown: what it runs, in words."""
    if fits:
        return PreflightItem("firmware", vehicle, "ok")
    text = f"it runs {flown}, and accept.firmware requires {wanted}"
    return PreflightItem("firmware", vehicle, "refused", text=text)


def home_item(
    vehicle: str, fence: Fence, position_ned_m: Vec3 | None, keep_m: float
) -> PreflightItem:
    """Return the preflight item that a vehicle is inside its fence."""
    if position_ned_m is None:
        return PreflightItem(
            "home", vehicle, "refused", None, keep_m, "m", "its position is not known"
        )
    margin_m = fence.margin_m(position_ned_m)
    if margin_m >= keep_m:
        return PreflightItem("home", vehicle, "ok", margin_m, keep_m, "m")
    side = fence.boundary(position_ned_m)
    where = (
        f"it is {-margin_m:.2f} m outside of the fence's {side}"
        if margin_m < 0.0
        else f"it is {distinct_value_text(margin_m, keep_m)} m from the fence's {side}, "
        f"nearer than {keep_m:g} m"
    )
    return PreflightItem("home", vehicle, "refused", margin_m, keep_m, "m", where)


def earth_item(
    vehicle: str, off_m: float | None, turned_deg: float, place_deg: tuple[float, float]
) -> PreflightItem:
    """Return the preflight item that a vehicle stands as its fence in degrees supposes it.

    off_m: from its start, at this latitude and longitude by the world's origin; None for unknown.
    turned_deg: its heading from its start's.
    """
    if off_m is not None and off_m <= _GPS_M and abs(turned_deg) <= _TURNED_DEG:
        return PreflightItem("home", vehicle, "ok", off_m, _GPS_M, "m")
    off = "at an unknown distance" if off_m is None else f"{off_m:.0f} m"
    text = (
        f"it stands {off} from its start ({place_deg[0]:.6f}, {place_deg[1]:.6f} by the world's "
        f"origin), turned by {turned_deg:.0f} degrees; its fence, which is given in degrees, would "
        "be so as well: correct its start or the origin"
    )
    return PreflightItem("home", vehicle, "refused", off_m, _GPS_M, "m", text)


def separation_item(vehicle: str, other: str, apart_m: float, needed_m: float) -> PreflightItem:
    """Return the preflight item of the horizontal distance between two vehicles' fences."""
    if apart_m >= needed_m:
        return PreflightItem("separation", vehicle, "ok", apart_m, needed_m, "m")
    message = f"its fence and that of {other} are {apart_m:.2f} m apart, so that they can touch"
    return PreflightItem("separation", vehicle, "refused", apart_m, needed_m, "m", message)


def distance_item(
    vehicle: str, other: str, measured_m: float | None, *, stated_m: float
) -> PreflightItem:
    """Return the preflight item that two vehicles are as far apart as the campaign says.

    measured_m: by latitude and longitude of both; None where one does not know its own.
    """
    if measured_m is None or not math.isfinite(measured_m):
        message = (
            f"its distance from {other} is not known: one of them has no latitude and longitude"
        )
        return PreflightItem("distance", vehicle, "refused", None, stated_m, "m", message)
    if not abs(measured_m - stated_m) <= _GPS_M:  # NaN is refused as well.
        message = (
            f"it is {measured_m:.1f} m from {other} by both receivers, and {stated_m:.1f} m by "
            "the campaign"
        )
        return PreflightItem("distance", vehicle, "refused", measured_m, stated_m, "m", message)
    return PreflightItem("distance", vehicle, "ok", measured_m, stated_m, "m")


def gps_items(
    vehicle: str,
    fix: tuple[int, int | None, float | None] | None,
    *,
    min_satellites: int,
    max_hdop: float,
) -> tuple[PreflightItem, ...]:
    """Return the preflight items of a GPS fix: kind, satellites, accuracy.

    fix: GPS_FIX_TYPE, satellites, and HDOP; None where the vehicle reports none.
    """
    if fix is None:
        return (
            PreflightItem("gps", vehicle, "refused", text="it reports nothing of its GPS receiver"),
        )
    kind, satellites, hdop = fix
    if kind < _FIX_WITH_HEIGHT:
        message = _NO_RECEIVER if kind == 0 else "it has no 3D fix"
        return (
            PreflightItem(
                "gps", vehicle, "refused", float(kind), float(_FIX_WITH_HEIGHT), text=message
            ),
        )
    # As floats, because integers would not be read back from a result as they were written.
    seen = None if satellites is None else float(satellites)
    least = float(min_satellites)
    return (
        at_least_item(
            "gps", vehicle, seen, least, unit="", what="the number of visible satellites"
        ),
        at_most_item("gps", vehicle, hdop, max_hdop, unit="", what="HDOP"),
    )


def ground_truth_item(
    vehicle: str, rate_hz: float | None, *, wanted_hz: float, message: str, refused: str
) -> PreflightItem:
    """Return the preflight item of a simulator's ground truth: usable, and often enough.

    message: its MAVLink message. refused: why the last one was not usable; empty if it was.
    """
    least_hz = _LEAST_TRUTH * wanted_hz
    if rate_hz is None:
        text = refused or f"its simulator sends no {message}: is it a simulation?"
        text += "; pose_source: mavlink judges by its estimate"
        return PreflightItem("ground_truth", vehicle, "refused", None, least_hz, "Hz", text)
    what = f"the rate of its simulator's {message}"
    return at_least_item("ground_truth", vehicle, rate_hz, least_hz, unit="Hz", what=what)


def permitted_item(by: str, text: str) -> PreflightItem:
    """Return the preflight item of what is unsafe and the campaign permits operators, by a key."""
    return PreflightItem("operator", "", "overridden", text=text, by=by)


def pair_item(real_m: Vec3 | None, twin_m: Vec3 | None, tolerance_m: float) -> PreflightItem:
    """Return the preflight item that the pair has equal offsets from the start poses."""
    apart_m = None if real_m is None or twin_m is None else norm(subtract(real_m, twin_m))
    what = "the difference of the offsets of real and twin from their start poses"
    return at_most_item("pair", "", apart_m, tolerance_m, unit="m", what=what)


def _beside(actual: float, limit: float, unit: str, side: str) -> str:
    """Return a preflight value and its limit with their unit, as text that tells them apart."""
    shown = f"{actual:.0f}" if abs(actual) >= 1000.0 else f"{actual:.3g}"
    if float(shown) == limit or (float(shown) < limit) != (actual < limit):
        shown = distinct_value_text(actual, limit)
    return f"{f'{shown} {unit}'.rstrip()}, and {side} {f'{limit:g} {unit}'.rstrip()}"
