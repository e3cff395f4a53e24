"""Loaded by every Python process of a flight under fault, by PYTHONPATH: nothing of the product.

Inside an embedded vehicle's process, started or forked, it tells the harness the truth by UDP, ten
times a second and at its end: no file of the product's and no disk has a part in it. In all it
makes the wall clock one that can be stepped: by the seconds that stand in a file. Where libfaketime
steps it, time.sleep is replaced: that library refuses its deadlines on the monotonic clock (0.9.10:
EINVAL).
"""

import json
import os
import select
import socket
import sys
import time
from pathlib import Path

_EVERY_TICKS = 12
_VEHICLES = {"wil_campaign.vehicles.embedded", "wil_campaign.vehicles.vehicle_server"}
"""Programs that are vehicles, or of which vehicles are forked."""


def _step_clock(step: Path) -> None:
    real, real_ns = time.time, time.time_ns

    def offset_s() -> float:
        try:
            return float(step.read_text())
        except (OSError, ValueError):
            return 0.0

    time.time = lambda: real() + offset_s()
    time.time_ns = lambda: real_ns() + int(offset_s() * 1e9)


def _tell_truth(port: int) -> None:
    from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle

    tellers: list[socket.socket] = []  # of this process: a fork has none of its server's
    ticks = 0

    def tell(self: EmbeddedVehicle) -> None:
        truth = self.truth()
        said = {
            "vehicle": self.config.source,
            "place": [*truth.pose.position_ned_m, truth.velocity_ned_m_s[2]],
            "armed": self.autopilot.flight.armed,
        }
        if not tellers:
            tellers.append(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        tellers[0].sendto(json.dumps(said).encode(), ("127.0.0.1", port))

    tick, kill = EmbeddedVehicle._tick, EmbeddedVehicle.kill

    def ticked(self: EmbeddedVehicle) -> None:
        nonlocal ticks
        tick(self)
        ticks += 1
        if ticks % _EVERY_TICKS == 0:
            tell(self)

    def killed(self: EmbeddedVehicle) -> None:
        tell(self)
        kill(self)

    setattr(EmbeddedVehicle, "_tick", ticked)  # noqa: B010  # a method is replaced
    setattr(EmbeddedVehicle, "kill", killed)  # noqa: B010


def _sleep(seconds: float) -> None:
    if seconds < 0.0:
        raise ValueError("sleep length must be non-negative")
    select.select((), (), (), seconds)


if "libfaketime" in os.environ.get("LD_PRELOAD", ""):
    setattr(time, "sleep", _sleep)  # noqa: B010  # a function is replaced
if "WIL_FAULTS_STEP" in os.environ:
    _step_clock(Path(os.environ["WIL_FAULTS_STEP"]))
    if _VEHICLES & set(sys.orig_argv):
        _tell_truth(int(os.environ["WIL_FAULTS_PORT"]))
