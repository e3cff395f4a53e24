"""Compares a flight's figures with the firmware's ranges; pure except for reading the ranges."""

import json
import math
from pathlib import Path
from typing import NamedTuple

from wil_campaign.plugins.step_response.figures import Figures

LIMIT = 0.15
"""The allowed deviation of a figure from the firmware's range, relative to the nearer end."""
FIRMWARES: dict[str, str] = {
    "px4": "PX4 of August 2026 in SIH",
    "ardupilot": "ArduCopter 4.7 in SITL",
}
"""The firmware that was flown four times for the ranges, and that embedded vehicles emulate."""
_OVERSHOOT = {"m": 0.15, "g": 5.0}
"""The deviation of an overshoot, which may be near zero, is relative to 0.15 m, or 5 degrees."""

Ranges = dict[str, dict[str, tuple[float, float]]]


class FigureRow(NamedTuple):
    """A figure: of the firmware (least, most), of the vehicle, and its deviation.

    off: the deviation relative to the range's nearer end; infinite without a figure.
    """

    segment: str
    name: str
    firmware: tuple[float, float]
    flown: float | None
    off: float

    @property
    def beyond(self) -> bool:
        """Return whether the figure is beyond the limit."""
        return abs(self.off) > LIMIT


def load_ranges(autopilot: str) -> Ranges:
    """Return the least and the most of each figure over four flights of the firmware."""
    file = Path(__file__).with_name(f"{autopilot}.json")
    ranges: Ranges = json.loads(file.read_text("utf-8"))
    return ranges


def compare_figures(firmware: Ranges, flown: Figures) -> list[FigureRow]:
    """Return each figure's deviation from the firmware's range."""
    rows = []
    for segment, figures in firmware.items():
        for name, (least, most) in figures.items():
            here = flown.get(segment, {}).get(name)
            rows.append(
                FigureRow(segment, name, (least, most), here, _deviation(name, here, least, most))
            )
    return rows


def _deviation(name: str, here: float | None, least: float, most: float) -> float:
    if here is None or not math.isfinite(here):
        return math.inf
    end = min(max(here, least), most)
    if name.startswith("overshoot"):
        return (here - end) / _OVERSHOOT[name[-1]] * LIMIT
    return here / end - 1.0
