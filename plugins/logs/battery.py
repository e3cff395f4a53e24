"""The battery of a logged flight, as a profile has it; pure."""

from collections.abc import Mapping
from dataclasses import dataclass
from statistics import median

from wil_campaign.plugins.logs.course import Course
from wil_campaign.plugins.logs.logged_flight import LoggedFlight

_CELLS = ("BAT1_N_CELLS", "BAT_N_CELLS", "BAT_N_CELLS_1")
_CAPACITY = ("BAT1_CAPACITY", "BAT_CAPACITY", "BATT_CAPACITY")
_FULL_V, _EMPTY_V = 4.2, 3.5
"""Of a lithium polymer cell, as of the shipped profiles."""
_LEAST_SAMPLES = 5


@dataclass(frozen=True, slots=True)
class Battery:
    """The keys of a profile's `battery` that a log tells, with their values."""

    values: Mapping[str, float]


def battery_of(flight: LoggedFlight, course: Course | None) -> Battery | None:
    """Return what a log tells of the battery; None where that is nothing."""
    found: dict[str, float] = {}
    cells = _first(flight, _CELLS)
    if not cells and flight.power:
        cells = float(round(max(one.voltage_v for one in flight.power) / 4.1))
    if cells:
        found["full_v"] = round(cells * _FULL_V, 2)
        found["empty_v"] = round(cells * _EMPTY_V, 2)
    capacity = _first(flight, _CAPACITY)
    if capacity:
        found["capacity_mah"] = round(capacity, 0)
    if course is not None:
        end_s = course.start.t_s + course.duration_s
        amperes = [
            one.current_a
            for one in flight.power
            if one.current_a is not None and course.start.t_s <= one.t_s <= end_s
        ]
        if len(amperes) >= _LEAST_SAMPLES and median(amperes) > 0.5:
            found["hover_current_a"] = round(median(amperes), 2)
    return Battery(found) if found else None


def _first(flight: LoggedFlight, names: tuple[str, ...]) -> float:
    """Return the first positive value of parameters; 0 for none."""
    return next((value for name in names if (value := flight.parameters.get(name, 0.0)) > 0), 0.0)
