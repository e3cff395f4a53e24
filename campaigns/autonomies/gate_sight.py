"""The sight of a gate in an image: its direction and width, as slopes in a level frame."""

import math
from dataclasses import dataclass

from wil_campaign.api import Blob, Intrinsics, Opening, Quat, rotate


@dataclass(frozen=True, slots=True)
class GateBearing:
    """The slope of the line of sight to the gate's centre on one axis: metres per metre ahead.

    only_side: the image cuts the gate off, so that the slope gives the side, not the distance.
    """

    slope: float
    only_side: bool = False


@dataclass(frozen=True, slots=True)
class GateSight:
    """A sight of the gate from one pose, in a level frame ahead of the vehicle.

    right, down: None where the image does not show it. width: of the opening, as a slope; None
    likewise.
    """

    right: GateBearing | None
    down: GateBearing | None
    width: float | None = None

    @property
    def only_side(self) -> bool:
        """Return whether the gate is cut off by the image's edge and its centre unknown."""
        return any(axis is not None and axis.only_side for axis in (self.right, self.down))


NOTHING = GateSight(None, None)


@dataclass(frozen=True, slots=True)
class GateCameraView:
    """The view of a camera: pinhole, attitude (FRD to NED), and the heading of the level frame."""

    intrinsics: Intrinsics
    q_wxyz: Quat
    heading_rad: float

    def slopes(self, u_px: float, v_px: float) -> tuple[float, float] | None:
        """Return a pixel's slopes right and down per metre ahead; None behind the camera."""
        pinhole = self.intrinsics
        ray = (
            1.0,
            (u_px - pinhole.cx_px) / pinhole.fx_px,
            (v_px - pinhole.cy_px) / pinhole.fy_px,
        )
        north, east, down = rotate(self.q_wxyz, ray)
        cos, sin = math.cos(self.heading_rad), math.sin(self.heading_rad)
        ahead = north * cos + east * sin
        return ((east * cos - north * sin) / ahead, down / ahead) if ahead > 0.1 else None


def gate_sight_of(blob: Blob, view: GateCameraView) -> GateSight:
    """Return the sight of the gate in an image; None where the image shows no gate.

    The opening gives the centre along each axis on which both its ends are in view. Otherwise the
    centre of mass does. If one edge of the image cuts the gate's frame off, that gives the side
    only, and nothing if two opposite edges do.
    """
    opening, borders = blob.opening, blob.borders
    mass = view.slopes(*blob.centroid_px)
    if mass is None:
        return NOTHING
    right = _of_mass(mass[0], borders.left, borders.right)
    down = _of_mass(mass[1], borders.top, borders.bottom)
    if opening is None:
        return GateSight(right, down)
    u_px, v_px = _centre(opening)
    centre = view.slopes(u_px, v_px)
    if centre is None:
        return NOTHING
    return GateSight(
        GateBearing(centre[0]) if opening.across_px else right,
        GateBearing(centre[1]) if opening.down_px else down,
        _width(opening.across_px, v_px, view) if opening.across_px else None,
    )


def _of_mass(slope: float, cut_before: bool, cut_behind: bool) -> GateBearing | None:
    """Return the gate's bearing from its centre of mass; None when both sides are cut off."""
    if cut_before and cut_behind:
        return None
    return GateBearing(slope, only_side=cut_before or cut_behind)


def _centre(opening: Opening) -> tuple[float, float]:
    """Return the pixel centre of the gate's opening, along each axis by the ends in view."""
    across, down = opening.across_px, opening.down_px
    u_px, v_px = opening.centre_px
    if across and not down:
        return ((across[0] + across[1]) / 2.0, v_px)
    if down and not across:
        return (u_px, (down[0] + down[1]) / 2.0)
    return (u_px, v_px)


def _width(across: tuple[float, float], v_px: float, view: GateCameraView) -> float | None:
    """Return the apparent width of the gate's opening, as a slope; None behind the camera."""
    left, right = view.slopes(across[0], v_px), view.slopes(across[1], v_px)
    if left is None or right is None:
        return None
    return math.hypot(right[0] - left[0], right[1] - left[1])
