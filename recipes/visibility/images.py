"""Visibility of virtual objects in a mixed image: changed pixels against expected outlines. Pure.

A recipe that isolates objects leaves the other pixels of the real image exactly as they were, so
that the changed pixels *are* the virtual objects as the autonomy sees them, whatever their colours.
Where a recipe changes more than that (a blend, a replaced image), the expected image is searched in
the mixture instead (`wil_campaign.recipes.visibility.matching`).
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from wil_campaign.recipes.visibility.exchange import ColoredImages, with_exchanged
from wil_campaign.recipes.visibility.matching import best_shift
from wil_campaign.recipes.visibility.model import (
    ExpectedImage,
    FrameVisibility,
    Mask,
    ObjectVisibility,
    VirtualObjects,
)
from wil_campaign.vehicles.readings import BgrImage

Distances = NDArray[np.float32]

IN_VIEW_SHARE = 1e-3
"""Least share of the image of an object in view: 18 x 17 pixels of 640 x 480."""
SHOWN_SHARE = 0.25
"""Least share of an object that has to be visible: light and colours may hide parts of it."""
CONTRAST_SHARE = 0.2
"""Least share of the contrast between an object and the real image that a mixture has to have. An
even blend halves the contrast, a simulator's light may halve it again, and grey levels are whole
numbers; a blend of 2 % is invisible."""
LIMIT_SHARE_OF_WIDTH = 0.015
"""Default limit of the offset: 9.6 px of 640, 1 degree of a 69 degree camera. That is twice the
default attitude accuracy in `pose_accuracy` (0.5 degrees)."""
LIMIT_SHARE_OF_SIZE = 0.1
"""For a large object: a tenth of its apparent size, as a centimetre is many pixels then. For a gate
of 1 m this is a decimetre, about the clearance of such a flight."""
_BROAD = 3.0
"""If the changed area exceeds that of the objects so many times, a recipe changes other pixels."""
_MOST = 0.5
"""The same as a share of the image, where no object is in view."""
_OUTER, _INNER = 0.9, 0.5
"""Share of the shown outline, and of the expected one, that lies within the offset. Parts of the
expected one may be missing."""
_AROUND = 3
_MATCHED = 0.5
"""Least correlation with the expected image for it to be found."""
_HIDDEN_OUTLINE = 0.25
"""Largest share of an object's outline that may be in front of other virtual objects: there, the
pixels on both sides are changed and the outline is not visible."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImagePair:
    """The compared pixels of one mixed image, and what geometry expects there; of one size.

    t_s: exposure. real_bgr: the real image as the merge received it. limit_px: of the offset, in
    pixels of the full image; None for the default. is_like: whether the twin's image is rendered
    like `expected`, so that an object that is not found in it is missing.
    """

    t_s: float
    real_bgr: BgrImage
    mixed_bgr: BgrImage
    expected: ExpectedImage
    virtual: VirtualObjects
    limit_px: float | None
    is_like: bool


def compare_images(pair: ImagePair) -> FrameVisibility:
    """Return the visibility of virtual objects in a mixed image."""
    virtual, expected = pair.virtual, pair.expected
    pair = replace(pair, virtual=virtual.compared())
    changed: Mask = _change(pair.real_bgr, pair.mixed_bgr) > 0
    present = pair.virtual.mask_of(expected.ids)
    if expected.unknown is not None:
        changed &= ~expected.unknown
        present &= ~expected.unknown
    ids = np.where(present, expected.ids, np.uint8(0))
    taken = int(np.count_nonzero(present))
    is_due = taken >= IN_VIEW_SHARE * present.size
    if np.count_nonzero(changed) <= (_BROAD * taken if is_due else _MOST * present.size):
        found = compare_outlines(pair, changed, ids)
    else:
        found = _match_objects(replace(pair, virtual=virtual), changed, ids)
    if pair.is_like:
        found = replace(found, objects=_with_exchanged(pair, found.objects, changed, ids))
    known = expected.ids if expected.unknown is None else expected.ids * ~expected.unknown
    least = IN_VIEW_SHARE * known.size
    if through := _shown_through(pair, known):
        elsewhere = found.elsewhere + through
        found = replace(found, elsewhere=elsewhere, is_unexpected=True)
    sought = tuple(one for one in found.objects if one.name in virtual.names.values())
    not_mixed = virtual.not_mixed_in(_inner(known), least=least)
    return replace(found, objects=sought, not_mixed=not_mixed)


def _with_exchanged(
    pair: ImagePair, found: tuple[ObjectVisibility, ...], changed: Mask, ids: NDArray[np.uint8]
) -> tuple[ObjectVisibility, ...]:
    """Return the objects of a mixed image; those that are shown as each other are displaced."""
    images = ColoredImages(
        real_bgr=pair.real_bgr,
        mixed_bgr=pair.mixed_bgr,
        expected_bgr=pair.expected.image_bgr,
        ids=ids,
        changed=changed,
        px_per_sample=pair.expected.px_per_sample,
    )
    return with_exchanged(found, pair.virtual.names, images)


def well_within(mask: Mask) -> Mask:
    """Return the part of a mask that is farther from its outline than the default limit."""
    size = 2 * math.ceil(LIMIT_SHARE_OF_WIDTH * mask.shape[1]) + 1
    inner: Mask = cv2.erode(mask.astype(np.uint8), np.ones((size, size), np.uint8)) != 0
    return inner


def _shown_through(pair: ImagePair, known: NDArray[np.uint8]) -> float:
    """Return the share of an image that shows objects of which a physical one hides everything.

    One that is hidden in part alone may be drawn whole: without depth nothing is compared. 0 where
    it is too small to be in view.
    """
    hidden, least = pair.expected.hidden, IN_VIEW_SHARE * known.size
    if hidden is None or not hidden.any():
        return 0.0
    contrast = _change(pair.real_bgr, pair.expected.image_bgr).astype(np.float32)
    shown = hidden & (
        _change(pair.real_bgr, pair.mixed_bgr) > np.maximum(1.0, CONTRAST_SHARE * contrast)
    )
    counts = np.bincount(pair.expected.ids[shown], minlength=256)
    visible = np.bincount(known.reshape(-1), minlength=256)
    through = [counts[i] for i in pair.virtual.names if counts[i] >= least and not visible[i]]
    return float(sum(through)) / known.size


def compare_outlines(pair: ImagePair, changed: Mask, ids: NDArray[np.uint8]) -> FrameVisibility:
    """Return the visibility of objects by the outlines of the changed image areas."""
    per_sample, size, share = pair.expected.px_per_sample, changed.size, float(changed.mean())
    within = _without_edge(changed, _floor_px(pair) / per_sample)
    well_in = _inner(ids)
    part = _box(changed | (ids != 0))
    changed, within, ids = changed[part], within[part], ids[part]
    to_present, nearest = _distances(ids)
    changed &= _has_contrast(pair, part, ids, nearest)
    within &= changed
    to_changed, _ = _distances(changed.astype(np.uint8))
    outline = _outline(changed)
    shares = {one: _share_shown(changed, ids, nearest, one) for one in pair.virtual.names}
    without = _expected_without(pair, [one for one, share in shares.items() if not _is_seen(share)])
    objects = []
    for object_id, name in pair.virtual.names.items():
        own = ids == object_id
        count = int(np.count_nonzero(own))
        in_view = int(np.count_nonzero(well_in == object_id)) >= IN_VIEW_SHARE * size
        shown = shares[object_id]
        is_shown = in_view and _is_seen(shown)
        offset: float | None = None
        if is_shown:
            outer = _quantile(to_present[outline & (nearest == object_id)], _OUTER)
            inner = _quantile(to_changed[_outline(own)], _INNER)
            offset = max(outer, inner) * per_sample
        if offset is not None and _is_before_others(own, ids):
            is_shown, offset = _find_object(without, object_id, offset)
        extent, limit = count / size, _limit_px(own, pair)
        seen = ObjectVisibility(name, in_view, extent, shown, is_shown, offset, limit, "px")
        objects.append(seen)
    reach = (
        max([_floor_px(pair), *(visibility.limit for visibility in objects if visibility.in_view)])
        / per_sample
    )
    away = int(np.count_nonzero(within & (to_present > reach))) / size
    # An object in view may reach beyond its place; a filled opening, or another object, is more.
    due = sum(visibility.expected for visibility in objects if visibility.in_view)
    is_unexpected = away >= (max(2.0 * IN_VIEW_SHARE, 0.5 * due) if due else IN_VIEW_SHARE)
    return FrameVisibility(pair.t_s, tuple(objects), share, away, is_unexpected)


def _share_shown(
    changed: Mask, ids: NDArray[np.uint8], nearest: NDArray[np.uint8], object_id: int
) -> float:
    """Return the shown share of an object's image: the changed area nearest to it."""
    count = int(np.count_nonzero(ids == object_id))
    drawn = int(np.count_nonzero(changed & (nearest == object_id)))
    return min(1.0, drawn / count) if count else 0.0


def _is_seen(share: float) -> bool:
    """Return whether enough of an object's image is shown."""
    return share >= SHOWN_SHARE


def _expected_without(pair: ImagePair, missing: Iterable[int]) -> ImagePair:
    """Return a pair of images whose expected one has the real world in place of missing objects.

    An object is searched with what is expected around it: not with one behind it that is not shown.
    """
    there = np.isin(pair.expected.ids, list(missing))
    if not there.any():
        return pair
    image = np.where(there[:, :, None], pair.real_bgr, pair.expected.image_bgr)
    return replace(pair, expected=replace(pair.expected, image_bgr=image))


def _is_before_others(own: Mask, ids: NDArray[np.uint8]) -> bool:
    """Return whether virtual objects behind an object hide the outline of its changed area."""
    outline = _outline(own)
    others = cv2.dilate(((ids != 0) & ~own).astype(np.uint8), np.ones((3, 3), np.uint8)) != 0
    length = int(np.count_nonzero(outline))
    return int(np.count_nonzero(outline & others)) > _HIDDEN_OUTLINE * length


def _find_object(pair: ImagePair, object_id: int, offset: float) -> tuple[bool, float | None]:
    """Return whether a mixed image shows an object's texture, and how far from its place.

    offset: of its outline, in pixels, which counts where the expected image is not found: an
    external simulator's image may look different, and one without contrast cannot be searched.
    """
    own: Mask = pair.expected.ids == object_id
    if pair.expected.unknown is not None:
        own &= ~pair.expected.unknown
    shift = best_shift(pair.real_bgr, pair.mixed_bgr, pair.expected.image_bgr, own)
    if shift is None or (shift.correlation < _MATCHED and not pair.is_like):
        return True, offset
    if shift.correlation < _MATCHED or shift.contrast < CONTRAST_SHARE:
        return False, None
    return True, max(offset, shift.samples * pair.expected.px_per_sample)


def _has_contrast(
    pair: ImagePair, part: tuple[slice, slice], ids: NDArray[np.uint8], nearest: NDArray[np.uint8]
) -> Mask:
    """Return where a part of a mixed image has enough of the contrast of the nearest object.

    Where an object is expected, its contrast at that pixel counts, otherwise its mean contrast.
    """
    real = pair.real_bgr[part]
    contrast = CONTRAST_SHARE * _change(real, pair.expected.image_bgr[part]).astype(np.float32)
    usual = np.zeros(256, np.float32)
    for object_id in pair.virtual.names:
        own = ids == object_id
        usual[object_id] = contrast[own].mean() if own.any() else 0.0
    least = np.where(ids != 0, contrast, usual[nearest])
    found: Mask = _change(real, pair.mixed_bgr[part]) >= least
    return found


def _change(one_bgr: BgrImage, other_bgr: BgrImage) -> NDArray[np.uint8]:
    """Return the difference of two images in grey levels, in the channel that differs most."""
    one, other = np.ascontiguousarray(one_bgr), np.ascontiguousarray(other_bgr)
    blue, green, red = cv2.split(cv2.absdiff(one, other))
    return np.asarray(cv2.max(cv2.max(blue, green), red), np.uint8)


def _inner(ids: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the ids of an image without a border, as wide as the default limit of the offset.

    An object that is expected in the border alone may be outside of the image.
    """
    edge = math.ceil(LIMIT_SHARE_OF_WIDTH * ids.shape[1])
    return ids[edge:-edge, edge:-edge]


def _without_edge(changed: Mask, reach: float) -> Mask:
    """Return the changed area farther than `reach` samples from the image's edge.

    An object whose place is just outside of the image may reach into it by as much.
    """
    edge = math.ceil(reach)
    within = np.zeros_like(changed)
    within[edge:-edge, edge:-edge] = changed[edge:-edge, edge:-edge]
    return within


def _box(mask: Mask) -> tuple[slice, slice]:
    """Return the part of an image in which a mask lies, with the margin that outlines need."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not rows.size:
        return slice(0, 1), slice(0, 1)
    first_row, first_column = max(0, int(rows[0]) - _AROUND), max(0, int(columns[0]) - _AROUND)
    return (
        slice(first_row, int(rows[-1]) + _AROUND + 1),
        slice(first_column, int(columns[-1]) + _AROUND + 1),
    )


def _match_objects(pair: ImagePair, changed: Mask, ids: NDArray[np.uint8]) -> FrameVisibility:
    objects: list[ObjectVisibility] = []
    for object_id, name in pair.virtual.names.items():
        own = ids == object_id
        extent, limit = float(own.mean()), _limit_px(own, pair)
        if int(np.count_nonzero(_inner(ids) == object_id)) < IN_VIEW_SHARE * own.size:
            objects.append(ObjectVisibility(name, False, extent, 0.0, False, None, limit, "px"))
            continue
        found = best_shift(pair.real_bgr, pair.mixed_bgr, pair.expected.image_bgr, own)
        if found is None or (found.correlation < _MATCHED and not pair.is_like):
            why = "the recipe changes the whole image, and the twin's is not rendered by us"
            return FrameVisibility(pair.t_s, changed=float(changed.mean()), not_measured=why)
        # A hole of its shape in the changed area shows the real world, not the object.
        is_there = float(changed[own].mean()) >= SHOWN_SHARE
        is_visible = found.correlation >= _MATCHED and found.contrast >= CONTRAST_SHARE
        is_shown = is_there and is_visible
        offset = found.samples * pair.expected.px_per_sample if is_shown else None
        shown = max(0.0, found.correlation)
        objects.append(ObjectVisibility(name, True, extent, shown, is_shown, offset, limit, "px"))
    return FrameVisibility(pair.t_s, tuple(objects), float(changed.mean()))


def _floor_px(pair: ImagePair) -> float:
    """Return the limit of the image offset for objects that look small."""
    per_sample = pair.expected.px_per_sample
    if pair.limit_px is not None:
        return pair.limit_px + per_sample
    # In whole samples: an offset is not known any better.
    return float(max(1.0, LIMIT_SHARE_OF_WIDTH * pair.expected.ids.shape[1]) * per_sample)


def _limit_px(own: Mask, pair: ImagePair) -> float:
    """Return the limit of an object's image offset: grows with its size."""
    rows, columns = np.flatnonzero(own.any(axis=1)), np.flatnonzero(own.any(axis=0))
    if pair.limit_px is not None or not rows.size:
        return _floor_px(pair)
    high, wide = int(rows[-1] - rows[0]) + 1, int(columns[-1] - columns[0]) + 1
    size_px = pair.expected.px_per_sample * math.sqrt(high * wide)
    return max(_floor_px(pair), LIMIT_SHARE_OF_SIZE * size_px)


def _distances(ids: NDArray[np.uint8]) -> tuple[Distances, NDArray[np.uint8]]:
    """Return each image sample's distance to the nearest object, and that object's id."""
    mask = ids != 0
    away = np.where(mask, np.uint8(0), np.uint8(255))
    found = np.unique(ids[mask])
    if not found.size:
        return np.full(ids.shape, math.inf, np.float32), ids
    if found.size == 1:
        distance = cv2.distanceTransform(away, cv2.DIST_L2, cv2.DIST_MASK_5)
        return np.asarray(distance, np.float32), np.full_like(ids, found[0])
    distance, labels = cv2.distanceTransformWithLabels(
        away, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    table = np.zeros(int(labels.max()) + 1, np.uint8)
    table[labels[mask]] = ids[mask]
    return distance, table[labels]


_CROSS = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))


def _outline(mask: Mask) -> Mask:
    """Return the outline of a mask, without holes of one pixel and the image's own edge."""
    whole = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, _CROSS)
    inner = cv2.erode(whole, _CROSS)
    edge: Mask = (whole != 0) & (inner == 0)
    return edge


def _quantile(distances: NDArray[np.float32], share: float) -> float:
    """Return the distance within which this share of image samples lies, by nearest rank."""
    if not distances.size:
        return 0.0
    rank = max(0, math.ceil(share * distances.size) - 1)
    return float(np.partition(distances, rank)[rank])
