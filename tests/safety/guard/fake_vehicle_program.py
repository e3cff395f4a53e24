"""A fake vehicle as a program: PORT SYSTEM UP_M LOST_S LOG; lands by itself once nobody speaks."""

import asyncio
import math
import os
import signal
import sys
from pathlib import Path

from tests.safety.conftest import STEP_S, FakeVehicle
from wil_campaign.vehicles.autopilots.autopilot import FlightMode
from wil_campaign.vehicles.links.link_strings import parse_link
from wil_campaign.vehicles.links.udp import UdpLink


async def fly(port: int, system: int, up_m: float, lost_s: float, log: Path) -> None:
    loop = asyncio.get_running_loop()
    stop = asyncio.Event()
    loop.add_signal_handler(signal.SIGTERM, stop.set)
    loop.add_reader(0, lambda: stop.set() if not os.read(0, 100) else None)
    vehicle = FakeVehicle(f"fake {system}", system=system, up_m=up_m)
    heard_s = [math.inf]

    def take(data: bytes, t_s: float) -> None:
        if heard_s[0] == math.inf:
            vehicle.heard.append((t_s, "HELLO"))
        heard_s[0] = t_s
        vehicle.receive((data,), t_s)

    told = 0
    link = UdpLink(address=parse_link(f"udpout://127.0.0.1:{port}"))
    link.receive(take)
    async with link:
        with log.open("w") as words:
            while not stop.is_set():
                if loop.time() - heard_s[0] > lost_s and vehicle.mode is FlightMode.GUIDED:
                    vehicle.mode, vehicle.critical = FlightMode.LAND, True
                    words.write(f"{loop.time():.4f} FAILSAFE\n")
                vehicle.step(loop.time())
                link.write(vehicle.frames(loop.time()))
                for t_s, word in vehicle.heard[told:]:
                    words.write(f"{t_s:.4f} {word}\n")
                told = len(vehicle.heard)
                words.flush()
                await asyncio.sleep(STEP_S)
            words.write(f"{loop.time():.4f} END armed={vehicle.armed} up_m={vehicle.up_m:.2f}\n")


if __name__ == "__main__":
    _port, _system, _up_m, _lost_s, _log = sys.argv[1:]
    asyncio.run(fly(int(_port), int(_system), float(_up_m), float(_lost_s), Path(_log)))
