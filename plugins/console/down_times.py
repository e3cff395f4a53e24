"""When each vehicle of a run came down, by its states, its events or its guard."""

import re
from collections.abc import Mapping

from wil_campaign.orchestrator.live_feed.feed_messages import EventView, RunView, VehicleView

_GUARD_DOWN = re.compile(r": down\b")


class DownTimes:
    """The vehicles of a run that are down: on the ground and disarmed. Times: seconds since 1970.

    A state in which a vehicle is up or armed removes it.
    """

    def __init__(self) -> None:
        self._at_s: dict[str, float] = {}

    @property
    def at_s(self) -> Mapping[str, float]:
        """Return since when each vehicle that is down is known to be."""
        return self._at_s

    def add(self, vehicle: str, at_s: float) -> None:
        """Record that a vehicle is down; an earlier time stays."""
        self._at_s.setdefault(vehicle, at_s)

    def take_view(self, view: RunView, at_s: float) -> None:
        """Record which vehicles are down in a run's state; one without a message has none."""
        for vehicle in view.vehicles:
            if vehicle.silent_s is None:
                continue
            if _is_down(vehicle):
                self.add(vehicle.name, at_s)
            else:
                self._at_s.pop(vehicle.name, None)

    def take_event(self, event: EventView, newest: RunView | None, at_s: float) -> float | None:
        """Record a landing by an event; return its time, None for any other event.

        newest: the run's state; an event may arrive after a newer one, and is no news then.
        """
        is_landing = (event.kind == "guard" and _GUARD_DOWN.search(event.text) is not None) or (
            event.kind == "vehicle" and event.word == "disarmed"
        )
        if not is_landing or not event.vehicle or newest is None or event.t_s < newest.t_s:
            return None
        self.add(event.vehicle, at_s)
        return self._at_s[event.vehicle]


def _is_down(vehicle: VehicleView) -> bool:
    """Return whether a vehicle is disarmed, and on the ground as far as it says."""
    return not vehicle.armed and vehicle.landed in {"", "on_ground"}
