"""Checks readings for faults, with a kind to count by and a message; pure.

Costs per call: an image 2 us (shapes only), depth 23 us at 640x480 (one pass), a scan of 400
beams 4 us, 14,400 points 8 us.
"""

import math
from numbers import Real
from typing import Any

from wil_campaign.installed_plugins import plugin_of_module, whose_fault_text
from wil_campaign.vehicles.readings.faults import ReadingFault
from wil_campaign.vehicles.readings.images import CameraReading, DepthReading
from wil_campaign.vehicles.readings.kinds import Reading, faults_of_types, traits_of
from wil_campaign.vehicles.readings.numbers import is_numbers_reading, number_fields_of_reading
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.geodesy import LocalFrame


def reading_fault(reading: Reading) -> ReadingFault | None:
    """Return the first fault of a reading in itself; None when it has none.

    Raises TypeError where the check of a plugin's type returns no text.
    """
    if (fault := _time_fault(reading)) is not None:
        return fault
    check = traits_of(type(reading)).fault
    if is_numbers_reading(type(reading)) and (fault := _numbers(reading)) is not None:
        return fault
    if check is not None and (fault := check(reading)) is not None:
        return fault
    named = faults_of_types().get(type(reading))
    if named is None or (text := named(reading)) == "":
        return None
    if not isinstance(text, str):
        kind = type(reading)
        whose = whose_fault_text(plugin_of_module(kind.__module__))
        raise TypeError(f"the check of a {kind.__name__} returned {text!r}, not a text{whose}")
    return ReadingFault("out_of_range", text)


def reading_fault_after(reading: Reading, previous: Reading | None) -> ReadingFault | None:
    """Return the fault of a reading that follows another of the same sensor; or None."""
    if previous is None:
        return None
    if type(reading) is not type(previous):
        kinds = type(previous).__name__, type(reading).__name__
        return ReadingFault("changed", f"a {kinds[0]} is followed by a {kinds[1]}")
    if reading.t_s <= previous.t_s:
        times = f"{previous.t_s:.6f} s is followed by {reading.t_s:.6f} s"
        return ReadingFault("backwards", f"time does not advance: {times}")
    if isinstance(reading, CameraReading | DepthReading):
        return _camera_change_fault(reading.intrinsics, previous)
    return None


def _camera_change_fault(now: Intrinsics, previous: Reading) -> ReadingFault | None:
    """Return the fault of a reading whose camera changed; None when it did not."""
    before = getattr(previous, "intrinsics", now)
    if now == before:
        return None
    sizes = f"{before.width_px}x{before.height_px}", f"{now.width_px}x{now.height_px}"
    if sizes[0] != sizes[1]:
        return ReadingFault("changed", f"the image size was {sizes[0]} and is {sizes[1]}")
    return ReadingFault("changed", f"intrinsics were {before} and are {now}")


def _time_fault(reading: Reading) -> ReadingFault | None:
    """Return the fault of a reading's times; None when they are sound."""
    t_s, arrived_s = reading.t_s, reading.arrived_s
    if not (math.isfinite(t_s) and math.isfinite(arrived_s)):
        return ReadingFault("time", f"sampled at {t_s} s, delivered at {arrived_s} s")
    if arrived_s < t_s - _CLOCK_SLACK_S:
        return ReadingFault(
            "time", f"delivered at {arrived_s:.6f} s, before it was sampled ({t_s:.6f} s)"
        )
    return None


_CLOCK_SLACK_S = 0.05
"""A mapped clock's error (design: TIMESYNC) up to this much makes no reading faulty."""


def _numbers(reading: Any) -> ReadingFault | None:
    """Check a reading that is numbers alone; return its fault or None."""
    for name in number_fields_of_reading(type(reading)):
        if not isinstance(value := getattr(reading, name), Real):
            return ReadingFault("type", f"{name} is {value!r}, no number")
        if not math.isfinite(value):
            return ReadingFault("not_finite", f"{name} is {value}")
    return None


def reading_rest_fault(reading: Reading, *, pose: Pose, frame: LocalFrame) -> str | None:
    """Return what is wrong with a reading of a vehicle at rest, in words; None for nothing.

    At rest the right values are known closely, and a wrong unit is a factor of nine at the least (g
    for m/s2), a wrong axis a quarter of a turn. pose: of the vehicle in the world, from the source
    that judges it. frame: of the world on earth.
    """
    check = traits_of(type(reading)).at_rest
    return None if check is None else check(reading, pose, frame)
