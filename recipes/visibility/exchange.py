"""Virtual objects of which a mixed image shows each as the other one, by their mean colours. Pure.

Outlines alone do not distinguish objects of one shape: two persons, two gates. Light, tints and
blends change the colours of both alike; each has the colours of the other only in its place.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from wil_campaign.recipes.visibility.model import Ids, Mask, ObjectVisibility
from wil_campaign.vehicles.readings import BgrImage

Color = NDArray[np.float64]
"""A mean colour, (3,): blue, green, red, 0 to 255."""
Colors = NDArray[np.float64]
"""Those of two objects, (2, 3)."""

_DISTINCT = 20.0
"""Least difference of two objects' mean colours, in grey levels: below it noise and light may
exchange them."""
_BETTER = 0.5
"""Largest residual of the exchanged colours, as a share of that of the objects' own."""
_LEAST_PIXELS = 16
_LEAST_SHARE = 0.2
"""Least share of an object in a blend: the contrast that a mixture has to have."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ColoredImages:
    """The images whose colours are compared, of one size. ids: of the expected objects, 0 for none.

    changed: where the mixture differs from the real image.
    """

    real_bgr: BgrImage
    mixed_bgr: BgrImage
    expected_bgr: BgrImage
    ids: Ids
    changed: Mask
    px_per_sample: int


@dataclass(frozen=True, slots=True)
class _Place:
    """The place of an expected object. edges: left, right, top, bottom, in samples.

    real, mixed, expected: mean colours there, where the mixture differs from the real image; (3,).
    """

    real: Color
    mixed: Color
    expected: Color
    edges: tuple[int, int, int, int]


def with_exchanged(
    found: Iterable[ObjectVisibility], names: Mapping[int, str], images: ColoredImages
) -> tuple[ObjectVisibility, ...]:
    """Return the objects; those that are shown as each other are displaced, to the other's place.

    names: of the objects by id.
    """
    objects = {one.name: one for one in found}
    shown = {name: i for i, name in names.items() if name in objects and objects[name].is_shown}
    if len(shown) < 2:
        return tuple(objects.values())
    images = _around(shown.values(), images)
    places = {name: _place_of(i, images) for name, i in shown.items()}
    for pair in combinations(shown, 2):
        one, other = (places[name] for name in pair)
        if one is None or other is None or not _are_exchanged(one, other):
            continue
        apart = max(abs(a - b) for a, b in zip(one.edges, other.edges, strict=True))
        offset = float(apart * images.px_per_sample)
        for name, place_of in (pair, pair[::-1]):
            known = objects[name]
            if offset > max(known.limit, known.offset or 0.0):
                objects[name] = replace(known, offset=offset, place_of=place_of)
    return tuple(objects.values())


def _around(numbers: Iterable[int], images: ColoredImages) -> ColoredImages:
    """Return copies of the part around the objects of these ids, which OpenCV reads fast."""
    wanted = np.zeros(256, np.uint8)
    wanted[list(numbers)] = 1
    left, top, width, height = cv2.boundingRect(wanted[images.ids])
    part = np.s_[top : top + height, left : left + width]
    return ColoredImages(
        real_bgr=images.real_bgr[part].copy(),
        mixed_bgr=images.mixed_bgr[part].copy(),
        expected_bgr=images.expected_bgr[part].copy(),
        ids=images.ids[part].copy(),
        changed=images.changed[part].copy(),
        px_per_sample=images.px_per_sample,
    )


def _place_of(number: int, images: ColoredImages) -> _Place | None:
    """Return the place of the object of an id; None where too little of it is changed."""
    where = (images.ids == number).view(np.uint8)
    changed = where & images.changed.view(np.uint8)
    if cv2.countNonZero(changed) < _LEAST_PIXELS:
        return None
    left, top, width, height = cv2.boundingRect(where)
    return _Place(
        real=_mean_color(images.real_bgr, changed),
        mixed=_mean_color(images.mixed_bgr, changed),
        expected=_mean_color(images.expected_bgr, changed),
        edges=(left, left + width, top, top + height),
    )


def _mean_color(image_bgr: BgrImage, where: NDArray[np.uint8]) -> Color:
    return np.array(cv2.mean(image_bgr, where)[:3], np.float64)


def _are_exchanged(one: _Place, other: _Place) -> bool:
    """Return whether two objects have each other's colours rather than their own."""
    apart = one.expected - other.expected
    if float(np.linalg.norm(apart)) < _DISTINCT or float((one.mixed - other.mixed) @ apart) >= 0.0:
        return False
    real = np.stack([one.real, other.real])
    mixed = np.stack([one.mixed, other.mixed])
    expected = np.stack([one.expected, other.expected])
    own = _residual(real, mixed, expected)
    return _residual(real, mixed, expected[::-1]) < _BETTER * own


def _residual(real: Colors, mixed: Colors, objects: Colors) -> float:
    """Return what remains of mixed colours when the objects' are laid over the real ones.

    In the share that fits best: an overlay has all of it, a blend a part.
    """
    laid, change = objects - real, mixed - real
    power = float((laid * laid).sum())
    share = float((laid * change).sum()) / power if power > 0.0 else 1.0
    return float(np.linalg.norm(change - min(1.0, max(_LEAST_SHARE, share)) * laid))
