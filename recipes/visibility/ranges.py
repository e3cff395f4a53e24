"""Visibility of virtual objects in mixed ranges: beams, and depth pixels. Pure."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wil_campaign.recipes.visibility.model import (
    ExpectedRanges,
    FrameVisibility,
    Mask,
    ObjectVisibility,
    VirtualObjects,
)

SHOWN_SHARE = 0.5
"""Least share of the beams expected on an object that have to show its range."""
LIMIT_M, LIMIT_SHARE = 0.2, 0.05
"""Default limit of a range's error: 20 cm, or 5 % of the range: noise of 1 % (RPLIDAR A2M8), and
half a degree of attitude at an oblique surface."""
AMBIGUOUS_SHARE = 0.5
"""Share of that limit: a real surface nearer than this to a virtual one makes a beam ambiguous, as
its range would show the virtual object even without mixing."""
BLIND_WITHIN_M = 4.0
"""A sound sensor has a range of a physical surface that is nearer than this."""
_DUE_ELEMENTS, _DUE_SHARE = 20, 0.15
"""Where so many elements, and such a share of all, are due to have one, ..."""
_SEEN_SHARE, _COVER_M = 0.01, 0.15
"""... a reading with ranges beyond its cover in no more than this share of its elements is a
covered sensor's: of some covers nothing comes back, of others centimetres or zeros."""
LEAST_ELEMENTS = 2
"""Least number of beams on an object in view, for a sensor with several."""


def range_limits_m(ranges_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the largest accepted error of each mixed range, metres."""
    return np.maximum(LIMIT_M, LIMIT_SHARE * np.where(np.isfinite(ranges_m), ranges_m, 0.0))


def compare_ranges(
    *,
    t_s: float,
    real_m: NDArray[np.float64],
    mixed_m: NDArray[np.float64],
    expected: ExpectedRanges,
    virtual: VirtualObjects,
    reach_m: tuple[float, float],
    least: float = LEAST_ELEMENTS,
    nearest_m: float = np.inf,
) -> FrameVisibility:
    """Return the visibility of virtual objects in mixed ranges; arrays are (elements,).

    real_m: the real ranges as the merge received them; a nearer real surface hides a virtual one.
    reach_m: least and greatest range of the sensor. least: number of elements of an object in view.
    nearest_m: the nearest surface around the beams, where that is nearer than those in them.
    """
    due = np.asarray(expected.ranges_m, np.float64)
    limit = range_limits_m(due)
    is_clear = (due >= reach_m[0]) & (due <= reach_m[1]) & ~(real_m < due - limit)
    with np.errstate(invalid="ignore"):
        error = np.abs(mixed_m - due)
        is_distinct = ~(np.abs(real_m - due) <= AMBIGUOUS_SHARE * limit)
        is_real = np.abs(mixed_m - real_m) < error
        nearer = mixed_m < real_m - range_limits_m(mixed_m)
        away = nearer & (mixed_m < np.minimum(due, nearest_m) - limit)
        away |= _is_shown_through(real_m, mixed_m, expected.virtual or expected, virtual)
    visible = virtual.mask_of(expected.ids) & is_clear & is_distinct
    elements = ComparedRanges(error, nearer, (error <= limit) & ~is_real, limit)
    objects = tuple(
        object_visibility(name, visible & (expected.ids == object_id), elements, least)
        for object_id, name in virtual.names.items()
    )
    not_mixed = virtual.not_mixed_in(np.where(is_clear, expected.ids, np.uint8(0)), least=least)
    # Some beams beside the edge of an object in view may hit it unexpectedly.
    due_any = any(visibility.in_view for visibility in objects)
    own = float(np.count_nonzero(visible)) if due_any else 0.0
    most = max(2.0 * least, 0.5 * own)
    unexpected = bool(np.count_nonzero(away) >= max(1.0, min(most, away.size)))
    changed = _share(mixed_m != real_m)
    blind = _is_blind(real_m, expected, virtual, reach_m)
    return FrameVisibility(t_s, objects, changed, _share(away), unexpected, blind, not_mixed)


def _is_blind(
    real_m: NDArray[np.float64],
    expected: ExpectedRanges,
    virtual: VirtualObjects,
    reach_m: tuple[float, float],
) -> bool:
    """Return whether the real sensor saw nothing of what surely stands before it: it is covered."""
    due_m, not_real = expected.ranges_m, list(virtual.everything().names)
    is_due = (due_m >= reach_m[0]) & (due_m <= min(reach_m[1], BLIND_WITHIN_M))
    is_due &= (expected.ids != 0) & ~np.isin(expected.ids, not_real)
    is_seen = np.isfinite(real_m) & (real_m > _COVER_M)
    due, seen = np.count_nonzero(is_due), np.count_nonzero(is_seen)
    is_filled = due >= max(_DUE_ELEMENTS, _DUE_SHARE * real_m.size)
    return bool(is_filled and seen <= _SEEN_SHARE * real_m.size)


def _is_shown_through(
    real_m: NDArray[np.float64],
    mixed_m: NDArray[np.float64],
    expected: ExpectedRanges,
    virtual: VirtualObjects,
) -> Mask:
    """Return where the mixture has a virtual object's range, behind what the real sensor measured.

    expected: of the virtual world alone. The real surface is lost to the autonomy there.
    """
    limit = range_limits_m(expected.ranges_m)
    is_behind = real_m < expected.ranges_m - 2.0 * limit
    found: Mask = (
        virtual.mask_of(expected.ids) & is_behind & (np.abs(mixed_m - expected.ranges_m) <= limit)
    )
    return found


def _share(mask: Mask) -> float:
    """Return the share of ranges in a mask; 0 for none."""
    return float(mask.mean()) if mask.size else 0.0


@dataclass(frozen=True, slots=True)
class ComparedRanges:
    """The compared ranges, metres. error, limit: of each.

    nearer: where the mixture is nearer than the real one. right: where it has the virtual object's
    range, and not the real one.
    """

    error: NDArray[np.float64]
    nearer: Mask
    right: Mask
    limit: NDArray[np.float64]


def object_visibility(
    name: str, own: Mask, elements: ComparedRanges, least: float
) -> ObjectVisibility:
    """Return the visibility of an object. own: the ranges that are expected on it."""
    error, right, limit = elements.error, elements.right, elements.limit
    count = int(np.count_nonzero(own))
    in_view = count >= max(1.0, least)
    shown = int(np.count_nonzero(own & right)) / count if count else 0.0
    drawn = own & (elements.nearer | right) & np.isfinite(error)
    is_drawn = in_view and bool(np.count_nonzero(drawn) >= SHOWN_SHARE * count)
    offset = float(np.median(error[drawn])) if is_drawn else None
    allowed = float(np.median(limit[own])) if count else LIMIT_M
    extent = count / own.size if own.size else 0.0
    return ObjectVisibility(name, in_view, extent, shown, is_drawn, offset, allowed, "m")
