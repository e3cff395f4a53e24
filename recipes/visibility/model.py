"""Visibility of virtual objects in one mixture: expected images and ranges, and results. Pure."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from wil_campaign.vehicles.readings import BgrImage

Mask = NDArray[np.bool_]
Ids = NDArray[np.uint8]
Ranges = NDArray[np.float64]

Unit = Literal["px", "m"]


@dataclass(frozen=True, slots=True)
class VirtualObjects:
    """The objects that exist only in the virtual world, by the ids that images carry.

    names: those that a mixture has to show. not_mixed: the others, which a recipe that isolates
    objects by name leaves out. beside: the ids of those of the others that it may show as well.
    """

    names: dict[int, str]
    not_mixed: dict[int, str] = field(default_factory=dict)
    beside: frozenset[int] = frozenset()

    def everything(self) -> "VirtualObjects":
        """Return all of these objects as objects to be shown."""
        return VirtualObjects({**self.names, **self.not_mixed})

    def compared(self) -> "VirtualObjects":
        """Return the objects to be shown and those beside them, as objects to be shown."""
        beside = {i: name for i, name in self.not_mixed.items() if i in self.beside}
        return VirtualObjects({**self.names, **beside})

    def mask_of(self, ids: Ids) -> Mask:
        """Return the mask of the virtual objects in an image of ids."""
        wanted = np.zeros(256, np.bool_)
        wanted[list(self.names)] = True
        return wanted[ids]

    def not_mixed_in(self, ids: Ids, *, least: float) -> tuple[str, ...]:
        """Return the left-out objects with at least so many of these ids; 1 at least."""
        if not self.not_mixed:
            return ()
        counts = np.bincount(ids.reshape(-1), minlength=256)
        return tuple(name for i, name in self.not_mixed.items() if counts[i] >= max(1.0, least))


@dataclass(frozen=True, slots=True)
class ExpectedImage:
    """The expected image from geometry and an independent pose, (height, width) pixels.

    ids: of all objects in the virtual world. image_bgr: as our renderer draws these. unknown: where
    a physical object may hide a virtual one; pixels there do not count. px_per_sample: pixels of
    the full image from one of these to the next. hidden: where a physical object of the world file
    hides what ids has, farther from its outline than the default limit of the offset.
    """

    ids: Ids
    image_bgr: BgrImage
    unknown: Mask | None
    px_per_sample: int
    hidden: Mask | None = None


@dataclass(frozen=True, slots=True)
class ExpectedRanges:
    """The expected ranges from geometry, of each beam, depth pixel or point, (elements,) each.

    ranges_m: to the nearest surface, inf without one. ids: of the object there. virtual: the same
    of the virtual world alone; None where that is all.
    """

    ranges_m: Ranges
    ids: Ids
    virtual: "ExpectedRanges | None" = None


@dataclass(frozen=True, slots=True)
class ObjectVisibility:
    """The visibility of one virtual object in one mixture.

    expected: expected share of the reading, 0 to 1. shown: share of that in the mixture, 0 to 1.
    offset: distance of the shown object from its place, in `unit`; None where it is not shown.
    limit: of the offset. place_of: the object in whose place it is shown, which is shown in its
    own; "" for none.
    """

    name: str
    in_view: bool
    expected: float
    shown: float
    is_shown: bool
    offset: float | None
    limit: float
    unit: Unit
    place_of: str = ""

    @property
    def is_displaced(self) -> bool:
        """Return whether the virtual object is visible at another place than expected."""
        return self.offset is not None and self.offset > self.limit


@dataclass(frozen=True, slots=True)
class FrameVisibility:
    """The visibility of the virtual objects in one mixture.

    t_s: exposure of the real reading, run clock. changed: share of the reading that the recipe
    changed. elsewhere: share of the reading that shows something virtual farther than the limit
    from all expected objects; is_unexpected: whether no object is expected and that share is large
    enough to count as in view. is_blind: whether the real reading has nothing of the physical
    surfaces that fill most of it. not_mixed: objects in view that the recipe leaves out by name.
    not_measured: why this frame was not measured; "" when it was. confirms: it was measured
    before it was due, because the one before it was wrong: it counts in no share.
    """

    t_s: float
    objects: tuple[ObjectVisibility, ...] = ()
    changed: float = 0.0
    elsewhere: float = 0.0
    is_unexpected: bool = False
    is_blind: bool = False
    not_mixed: tuple[str, ...] = ()
    not_measured: str = ""
    confirms: bool = False
