"""Flies ArduCopter with dronekit 2.9 as its guide "Taking off" does; run as a program: URL.

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


def main(url: str) -> None:
    """Do everything once."""
    vehicle = dronekit.connect(url, wait_ready=True, timeout=WITHIN_S)
    report(f"connected {vehicle.version}, {len(vehicle.parameters)} parameters")
    vehicle.parameters["GUID_TIMEOUT"] = 2.5
    until(lambda: abs(vehicle.parameters["GUID_TIMEOUT"] - 2.5) < 1e-6)
    until(lambda: vehicle.is_armable)
    vehicle.mode = dronekit.VehicleMode("GUIDED")
    until(lambda: vehicle.mode.name == "GUIDED")
    vehicle.armed = True
    until(lambda: vehicle.armed)
    report("armed")
    vehicle.simple_takeoff(3)
    frame = vehicle.location
    until(lambda: frame.global_relative_frame.alt >= 3 * 0.95)
    report("took off")
    here = frame.global_relative_frame
    north = dronekit.LocationGlobalRelative(here.lat + 1e-4, here.lon, 3)
    vehicle.simple_goto(north, groundspeed=3)
    until(lambda: abs(frame.global_relative_frame.lat - north.lat) < 1e-5)
    report("went north")
    vehicle.mode = dronekit.VehicleMode("LAND")
    until(lambda: not vehicle.armed)
    report("landed")
    vehicle.close()


if __name__ == "__main__":
    main(sys.argv[1])
