"""Flies a vehicle with dronekit 2.9, as its guides do; run as a program: URL px4|ardupilot.

dronekit 2.9.2 as its index has it (2019) uses names that Python 3.10 removed from `collections`:
they are put back before it is imported. Connects, sets a parameter, arms, takes off, goes north,
lands; a line for each, and exit code 0 when all of it worked.
"""

import collections
import collections.abc
import sys
import time
from typing import Any

for name in ("MutableMapping", "Mapping", "Iterable"):
    if not hasattr(collections, name):
        setattr(collections, name, getattr(collections.abc, name))

import dronekit  # type: ignore[import-not-found]  # noqa: E402 - see above

WITHIN_S = 60.0


def until(true: Any) -> None:
    """Wait until something is true; raises TimeoutError."""
    end_s = time.monotonic() + WITHIN_S
    while not true():
        if time.monotonic() > end_s:
            raise TimeoutError
        time.sleep(0.05)


def report(text: str) -> None:
    """Tell that something worked."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def set_px4_mode(vehicle: Any, sub_mode: int) -> None:
    """Set one of PX4's automatic modes, which dronekit has no names for."""
    params = (1, 4, sub_mode, 0, 0, 0, 0)
    vehicle.send_mavlink(vehicle.message_factory.command_long_encode(0, 0, 176, 0, *params))


def main(url: str, autopilot: str) -> None:
    """Do everything once."""
    is_px4 = autopilot == "px4"
    vehicle = dronekit.connect(url, wait_ready=True, timeout=WITHIN_S)
    report(f"connected {vehicle.version}, {len(vehicle.parameters)} parameters")
    name, value = ("MIS_TAKEOFF_ALT", 3.0) if is_px4 else ("GUID_TIMEOUT", 2.5)
    vehicle.parameters[name] = value
    until(lambda: abs(vehicle.parameters[name] - value) < 1e-6)
    if not is_px4:
        until(lambda: vehicle.is_armable)
        vehicle.mode = dronekit.VehicleMode("GUIDED")
        until(lambda: vehicle.mode.name == "GUIDED")
    vehicle.armed = True
    until(lambda: vehicle.armed)
    report("armed")
    if is_px4:  # its own simple_takeoff names the place 0, 0, to which a PX4 would fly
        set_px4_mode(vehicle, 2)
    else:
        vehicle.simple_takeoff(3)
    frame = vehicle.location
    until(lambda: frame.global_relative_frame.alt >= 3 * 0.9)
    report("took off")
    here = frame.global_relative_frame
    north = dronekit.LocationGlobalRelative(here.lat + 1e-4, here.lon, 3)
    if is_px4:  # which refuses the mission item that simple_goto sends
        place = (-1, 1, 0, float("nan"), north.lat, north.lon, frame.global_frame.alt)
        vehicle.send_mavlink(vehicle.message_factory.command_long_encode(0, 0, 192, 0, *place))
    else:
        vehicle.simple_goto(north, groundspeed=3)
    until(lambda: abs(frame.global_relative_frame.lat - north.lat) < 1e-5)
    report("went north")
    if is_px4:
        set_px4_mode(vehicle, 6)
    else:
        vehicle.mode = dronekit.VehicleMode("LAND")
    until(lambda: not vehicle.armed)
    report("landed")
    vehicle.close()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
