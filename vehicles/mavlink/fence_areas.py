"""The fence areas of MAVLink fence items: inclusion and exclusion polygons and circles; pure.

Items 5000 to 5004: https://mavlink.io/en/services/mission.html#fence.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, NamedTuple, Protocol, TypeVar

from pymavlink.dialects.v20 import ardupilotmega as mavlink

POLYGONS: dict[int, bool] = {
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION: True,
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION: False,
}
CIRCLES: dict[int, bool] = {
    mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION: True,
    mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION: False,
}
"""Commands of fence items: whether they keep a vehicle inside."""
RETURN_POINT: int = mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT
DEGREES = 1e-7
"""The unit of x and y of an item."""


class FenceItemError(ValueError):
    """Fence items that form no fence area."""


class FencePlace(NamedTuple):
    """A corner or centre of a fence area on WGS-84, in degrees."""

    latitude_deg: float
    longitude_deg: float


Point = TypeVar("Point", bound=tuple[float, float])
"""A `FencePlace`, or north and east in metres."""


@dataclass(frozen=True, slots=True)
class FencePolygon(Generic[Point]):
    """A fence area that must not be left, or (inside=False) not be entered."""

    corners: tuple[Point, ...]
    inside: bool = True

    def __post_init__(self) -> None:
        if len(self.corners) < 3:
            raise ValueError(f"a fence's polygon has 3 corners or more, not {len(self.corners)}")


@dataclass(frozen=True, slots=True)
class FenceCircle(Generic[Point]):
    """A round fence area; `inside` as of a polygon."""

    centre: Point
    radius_m: float
    inside: bool = True

    def __post_init__(self) -> None:
        if not 0.0 < self.radius_m < math.inf:
            raise ValueError(f"a fence's circle has a radius above 0, not {self.radius_m} m")


FenceArea = FencePolygon[FencePlace] | FenceCircle[FencePlace]


class FenceItem(Protocol):
    """A MAVLink fence item (protocol); x and y in 1e-7 degrees."""

    @property
    def command(self) -> int:
        """The fence item's MAV_CMD."""

    @property
    def params(self) -> tuple[float, float, float, float]:
        """The fence item's parameters; first: count of corners, or the radius in metres."""

    @property
    def x(self) -> int:
        """The fence item's latitude."""

    @property
    def y(self) -> int:
        """The fence item's longitude."""


def fence_areas(items: Sequence[FenceItem]) -> tuple[FenceArea, ...]:
    """Return the fence areas of items; return points are left out. Raises FenceItemError."""
    areas: list[FenceArea] = []
    at = 0
    while at < len(items):
        item = items[at]
        count = 1
        if item.command in POLYGONS:
            corners = _corners(items, at)
            count = len(corners)
            areas.append(FencePolygon(tuple(map(_place, corners)), POLYGONS[item.command]))
        elif item.command in CIRCLES:
            if not 0.0 < item.params[0] < math.inf:
                raise FenceItemError(f"fence item {at} is a circle of radius {item.params[0]} m")
            areas.append(FenceCircle(_place(item), item.params[0], CIRCLES[item.command]))
        elif item.command != RETURN_POINT:
            message = f"fence item {at} has command {item.command}, which is not a fence item"
            raise FenceItemError(message)
        at += count
    return tuple(areas)


def _corners(items: Sequence[FenceItem], at: int) -> Sequence[FenceItem]:
    """Return the items of a fence polygon that begins at an index; each states their count."""
    stated = items[at].params[0]
    count = int(stated) if math.isfinite(stated) else 0
    corners = items[at : at + count]
    if count < 3 or len(corners) < count or {c.command for c in corners} != {items[at].command}:
        raise FenceItemError(f"fence item {at} begins a polygon that is incomplete")
    return corners


def _place(item: FenceItem) -> FencePlace:
    """Return a fence item's place in degrees."""
    return FencePlace(item.x * DEGREES, item.y * DEGREES)
