"""The autopilot's own fence: uploads and reads back its areas; the parameters that enable it.

Items 5000 to 5004: https://mavlink.io/en/services/mission.html#fence. Parameters: AC_Fence of
ArduPilot (FENCE_*), geofence_params.c of PX4 (GF_*).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.autopilots.autopilot import AutopilotName
from wil_campaign.vehicles.driver.onboard.mission_protocol import (
    ItemList,
    MissionError,
    MissionItem,
    MissionProtocol,
)
from wil_campaign.vehicles.driver.onboard.parameter_backup import ParameterValue
from wil_campaign.vehicles.mavlink.fence_areas import (
    CIRCLES,
    DEGREES,
    POLYGONS,
    FenceArea,
    FenceCircle,
    FenceItemError,
    Place,
    fence_areas,
)

FenceAction = Literal["report", "hold", "land", "rtl"]

_POLYGON_COMMANDS = {inside: command for command, inside in POLYGONS.items()}
_CIRCLE_COMMANDS = {inside: command for command, inside in CIRCLES.items()}
_ARDUPILOT_ACTIONS: dict[FenceAction, int] = {"report": 0, "rtl": 1, "land": 2, "hold": 4}
_PX4_ACTIONS: dict[FenceAction, int] = {"report": 1, "hold": 2, "rtl": 3, "land": 5}
_ALTITUDE_BIT, _AREAS_BIT = 1, 4
"""FENCE_TYPE: the highest altitude; polygons and circles."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotFence:
    """A fence that the autopilot itself enforces, as the fence protocol uploads it.

    ceiling_m: above home; None for no ceiling. action: of the autopilot on a breach.
    """

    areas: tuple[FenceArea, ...] = ()
    ceiling_m: float | None = None
    action: FenceAction = "land"

    def __post_init__(self) -> None:
        if not self.areas and self.ceiling_m is None:
            raise ValueError("a fence has areas, a ceiling, or both")
        if self.ceiling_m is not None and not 0.0 < self.ceiling_m < math.inf:
            raise ValueError(f"a fence's ceiling is above 0 m, not {self.ceiling_m} m")


def fence_items(areas: Sequence[FenceArea]) -> tuple[MissionItem, ...]:
    """Return the mission items of a fence's areas, for the fence protocol."""
    items: list[MissionItem] = []
    for area in areas:
        if isinstance(area, FenceCircle):
            items.append(_item(_CIRCLE_COMMANDS[area.inside], area.radius_m, area.centre))
        else:
            command, count = _POLYGON_COMMANDS[area.inside], float(len(area.corners))
            items += [_item(command, count, each) for each in area.corners]
    return tuple(items)


def fence_parameters(autopilot: AutopilotName, fence: AutopilotFence) -> dict[str, ParameterValue]:
    """Return the parameters that make an autopilot enforce a fence, in the order to set.

    Bounds come before the parameters that enable them, so that none is breached in between in
    flight; restored in reverse order, the fence is off before its bounds change.
    """
    if autopilot == "px4":
        # GF_MAX_*_DIST are distances from home; 0 is off.
        return {
            "GF_MAX_HOR_DIST": 0.0,
            "GF_MAX_VER_DIST": fence.ceiling_m or 0.0,
            "GF_ACTION": _PX4_ACTIONS[fence.action],
        }
    kinds = (_AREAS_BIT if fence.areas else 0) | (_ALTITUDE_BIT if fence.ceiling_m else 0)
    parameters: dict[str, ParameterValue] = {}
    if fence.ceiling_m is not None:
        parameters["FENCE_ALT_MAX"] = fence.ceiling_m
    return parameters | {
        # Avoidance keeps this distance from the fence, 2 m by default: too much in a hall.
        "FENCE_MARGIN": 0.0,
        "FENCE_TYPE": kinds,
        "FENCE_ACTION": _ARDUPILOT_ACTIONS[fence.action],
        "FENCE_ENABLE": 1,
    }


class FenceProtocol:
    """Uploads, reads back and removes the areas of the autopilot's own fence."""

    def __init__(self, *, missions: MissionProtocol) -> None:
        self._missions = missions

    async def upload(self, areas: Sequence[FenceArea]) -> None:
        """Upload fence areas in place of the present ones, and read them back.

        Raises MissionError; PX4 refuses a fence that excludes its home or is breached at once.
        """
        await self.restore(fence_items(areas))

    async def read(self) -> tuple[FenceArea, ...]:
        """Return the autopilot's fence areas. Raises MissionError."""
        items = await self._missions.download(ItemList.FENCE)
        try:
            return fence_areas(items)
        except FenceItemError as error:
            raise MissionError(str(error)) from error

    async def items(self) -> tuple[MissionItem, ...]:
        """Return the autopilot's fence items, for `restore`. Raises MissionError."""
        return await self._missions.download(ItemList.FENCE)

    async def restore(self, items: Sequence[MissionItem]) -> None:
        """Upload the fence items that `items` returned, and read them back. Raises MissionError."""
        if items:
            await self._missions.upload(ItemList.FENCE, items)
        else:
            await self._missions.clear(ItemList.FENCE)


def _item(command: int, first: float, place: Place) -> MissionItem:
    return MissionItem(
        command=command,
        frame=mavlink.MAV_FRAME_GLOBAL,
        params=(first, 0.0, 0.0, 0.0),
        x=round(place.latitude_deg / DEGREES),
        y=round(place.longitude_deg / DEGREES),
    )
