"""What the gate autonomy makes of a picture: where the gate is, as slopes in a level frame."""

import math
from dataclasses import dataclass

from campaigns.api import Blob, Intrinsics, Opening, Quat, rotate


@dataclass(frozen=True, slots=True)
class Bearing:
    """The slope of the line of sight to the gate's centre along one axis: metres per metre ahead.

    only_side: the gate is cut off there, so that the slope tells the side but not how far.
    """

    slope: float
    only_side: bool = False


@dataclass(frozen=True, slots=True)
class Sight:
    """The gate from one pose, in a level frame along the course.

    right, down: None where the picture does not tell. width: of the opening, as a slope; None
    likewise.
    """

    right: Bearing | None
    down: Bearing | None
    width: float | None = None

    @property
    def only_side(self) -> bool:
        """Return whether the gate is cut off and its centre not known."""
        return any(axis is not None and axis.only_side for axis in (self.right, self.down))


NOTHING = Sight(None, None)


@dataclass(frozen=True, slots=True)
class View:
    """How a camera looks: attitude of the camera (FRD to NED), course, pinhole."""

    intrinsics: Intrinsics
    q_wxyz: Quat
    course_rad: float

    def slopes(self, u_px: float, v_px: float) -> tuple[float, float] | None:
        """Return right and down per metre along the course; None when seen from behind."""
        pinhole = self.intrinsics
        ray = (
            1.0,
            (u_px - pinhole.cx_px) / pinhole.fx_px,
            (v_px - pinhole.cy_px) / pinhole.fy_px,
        )
        north, east, down = rotate(self.q_wxyz, ray)
        cos, sin = math.cos(self.course_rad), math.sin(self.course_rad)
        ahead = north * cos + east * sin
        return ((east * cos - north * sin) / ahead, down / ahead) if ahead > 0.1 else None


def sight_of(blob: Blob, view: View) -> Sight:
    """Return where a gate is that a picture shows, as far as the picture tells.

    The opening tells the centre along each axis on which both its ends are in view. Otherwise the
    centre of mass does, but of a frame that one edge of the picture cuts off it tells the side
    only, and of one that two opposite edges cut off nothing.
    """
    opening, borders = blob.opening, blob.borders
    mass = view.slopes(*blob.centroid_px)
    if mass is None:
        return NOTHING
    right = _of_mass(mass[0], borders.left, borders.right)
    down = _of_mass(mass[1], borders.top, borders.bottom)
    if opening is None:
        return Sight(right, down)
    u_px, v_px = _centre(opening)
    centre = view.slopes(u_px, v_px)
    if centre is None:
        return NOTHING
    return Sight(
        Bearing(centre[0]) if opening.across_px else right,
        Bearing(centre[1]) if opening.down_px else down,
        _width(opening.across_px, v_px, view) if opening.across_px else None,
    )


def _of_mass(slope: float, cut_before: bool, cut_behind: bool) -> Bearing | None:
    if cut_before and cut_behind:
        return None
    return Bearing(slope, only_side=cut_before or cut_behind)


def _centre(opening: Opening) -> tuple[float, float]:
    """Return the opening's centre of mass; the middle of what is whole where the rest is cut."""
    across, down = opening.across_px, opening.down_px
    u_px, v_px = opening.centre_px
    if across and not down:
        return ((across[0] + across[1]) / 2.0, v_px)
    if down and not across:
        return (u_px, (down[0] + down[1]) / 2.0)
    return (u_px, v_px)


def _width(across: tuple[float, float], v_px: float, view: View) -> float | None:
    left, right = view.slopes(across[0], v_px), view.slopes(across[1], v_px)
    if left is None or right is None:
        return None
    return math.hypot(right[0] - left[0], right[1] - left[1])
