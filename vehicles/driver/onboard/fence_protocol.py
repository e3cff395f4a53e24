"""The autopilot's own fence: uploads and reads back its areas.

Items 5000 to 5004: https://mavlink.io/en/services/mission.html#fence.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.autopilots.autopilot import FenceAction
from wil_campaign.vehicles.autopilots.registry import autopilot_named
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
    FencePlace,
    fence_areas,
)

_POLYGON_COMMANDS = {inside: command for command, inside in POLYGONS.items()}
_CIRCLE_COMMANDS = {inside: command for command, inside in CIRCLES.items()}


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotFence:
    """A fence that the autopilot itself enforces, as the fence protocol uploads it.

    ceiling_m: above home; None for no ceiling. action: of the autopilot on a breach.
    """

    areas: tuple[FenceArea, ...] = ()
    ceiling_m: float | None = None
    action: FenceAction = "land"

    def parameters(self, autopilot: str) -> dict[str, ParameterValue]:
        """Return the parameters that make an autopilot enforce the fence, in the order to set."""
        return autopilot_named(autopilot).fence_parameters(
            has_areas=bool(self.areas), ceiling_m=self.ceiling_m, action=self.action
        )

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


def _item(command: int, first: float, place: FencePlace) -> MissionItem:
    return MissionItem(
        command=command,
        frame=mavlink.MAV_FRAME_GLOBAL,
        params=(first, 0.0, 0.0, 0.0),
        x=round(place.latitude_deg / DEGREES),
        y=round(place.longitude_deg / DEGREES),
    )
