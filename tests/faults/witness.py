"""Looks at what vehicles truly do, by nobody's word but the physics'."""

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

HEIGHT_M = 1.0
"""Both goals of the fault campaigns are flown at 1.2 m."""
GATE_NORTH_M, GATE_EAST_M = 3.0, 1.1
"""Where worlds/gate.yaml has the gate that both fly through."""
_HALF_GATE_M = 0.5
_ON_GROUND_M = 0.2
_FALLEN_M_S = 2.0
"""Nobody lands so fast: motors were cut in the air."""
_LOOK_S = 0.05


@dataclass(slots=True)
class Sight:
    """What was seen of one vehicle. top_m: greatest height; sink_m_s: fastest way down, low."""

    armed: bool = False
    up_m: float = 0.0
    top_m: float = 0.0
    sink_m_s: float = 0.0
    through_gate: bool = False
    flew: bool = False
    north_m: float = 0.0
    down_s: float = 0.0
    """Since when it has been down."""

    @property
    def down(self) -> bool:
        """Return whether it stands on the ground, disarmed."""
        return not self.armed and abs(self.up_m) < _ON_GROUND_M

    @property
    def fell(self) -> bool:
        """Return whether it came down as nothing does that flies."""
        return self.sink_m_s > _FALLEN_M_S

    def see(self, t_s: float, place: tuple[float, float, float, float], armed: bool) -> None:
        """Take one moment. place: north, east, up in m, sinking in m/s."""
        north_m, east_m, up_m, sink_m_s = place
        self.flew = self.flew or (armed and up_m > _ON_GROUND_M)
        self.top_m = max(self.top_m, up_m)
        if up_m < HEIGHT_M:
            self.sink_m_s = max(self.sink_m_s, sink_m_s)
        passes = self.north_m < GATE_NORTH_M <= north_m
        level = abs(east_m - GATE_EAST_M) < _HALF_GATE_M and up_m > _ON_GROUND_M
        self.through_gate = self.through_gate or (passes and level)
        was_down = self.down
        self.armed, self.up_m, self.north_m = armed, up_m, north_m
        if not (was_down and self.down):
            self.down_s = t_s


class Witness:
    """Watches embedded vehicles of this process from its own timer until the loop ends."""

    def __init__(self, vehicles: Mapping[str, Any]) -> None:
        self._vehicles = vehicles
        self.sights = {name: Sight() for name in vehicles}

    def watch(self) -> None:
        """Look now, and every twentieth of a second from now on."""
        self.look()
        asyncio.get_running_loop().call_later(_LOOK_S, self.watch)

    def look(self) -> None:
        """Take where all are now."""
        for name, vehicle in self._vehicles.items():
            truth = vehicle.truth()
            north_m, east_m, down_m = truth.pose.position_ned_m
            armed = vehicle.autopilot.flight.armed
            place = (north_m, east_m, -down_m, truth.velocity_ned_m_s[2])
            self.sights[name].see(asyncio.get_running_loop().time(), place, armed)

    def not_completed(self, *, but: str = "") -> list[str]:
        """Return what was not seen of a flight through the gate and back to the ground.

        but: a vehicle of which nothing is asked.
        """
        found: list[str] = []
        for name, seen in self.sights.items():
            if name == but:
                continue
            if seen.top_m < HEIGHT_M:
                found.append(f"{name} was never at height")
            if not seen.down:
                found.append(f"{name} did not end on the ground, disarmed")
        subject = self.sights.get("real")
        if subject is None or not subject.through_gate:
            found.append("real did not fly through the gate")
        return found
