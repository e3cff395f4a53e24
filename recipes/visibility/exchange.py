"""Virtual objects of which a mixed image shows each as the other one, by their mean colours. Pure.

Outlines alone do not distinguish objects of one shape: two persons, two gates. Light, tints and
blends change the colours of both alike; each has the colours of the other only in its place.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from wil_campaign.recipes.visibility.model import Ids, Mask, ObjectVisibility
from wil_campaign.vehicles.readings import BgrImage

Colors = NDArray[np.float64]
"""Mean colours of two objects, (2, 3): blue, green, red, 0 to 255."""

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


def with_exchanged(
    found: Iterable[ObjectVisibility], names: Mapping[int, str], images: ColoredImages
) -> tuple[ObjectVisibility, ...]:
    """Return the objects; those that are shown as each other are displaced, to the other's place.

    names: of the objects by id.
    """
    objects = {one.name: one for one in found}
    shown = [i for i, name in names.items() if name in objects and objects[name].is_shown]
    for pair in combinations(shown, 2):
        if not _are_exchanged(pair, images):
            continue
        offset = _apart_samples(pair, images.ids) * images.px_per_sample
        for own, other in (pair, pair[::-1]):
            one = objects[names[own]]
            if offset > max(one.limit, one.offset or 0.0):
                objects[one.name] = replace(one, offset=offset, place_of=names[other])
    return tuple(objects.values())


def _are_exchanged(pair: tuple[int, int], images: ColoredImages) -> bool:
    """Return whether two objects have each other's colours rather than their own."""
    places = [(images.ids == one) & images.changed for one in pair]
    if any(np.count_nonzero(place) < _LEAST_PIXELS for place in places):
        return False
    real, mixed, expected = (
        np.array([image[place].mean(axis=0) for place in places], np.float64)
        for image in (images.real_bgr, images.mixed_bgr, images.expected_bgr)
    )
    apart = expected[0] - expected[1]
    if float(np.linalg.norm(apart)) < _DISTINCT or float((mixed[0] - mixed[1]) @ apart) >= 0.0:
        return False
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


def _apart_samples(pair: tuple[int, int], ids: Ids) -> float:
    """Return the largest difference of two objects' edges: of place or size, in image samples."""
    boxes = []
    for one in pair:
        rows, columns = np.nonzero(ids == one)
        boxes.append((rows.min(), rows.max(), columns.min(), columns.max()))
    return float(max(abs(int(one) - int(other)) for one, other in zip(*boxes, strict=True)))
