"""Links, drivers and guard on the wall clock: latencies, jitter, rates and their cost.

`python bench/links.py`; two embedded vehicles in processes of their own, over UDP, through the
guard's process, as a run has them. One line per figure, with its mark; quote ratios of one run.
"""

import asyncio
import contextlib
import itertools
import os
import sys
import tempfile
import time
from collections.abc import AsyncIterator
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.ports import free_port
from wil_campaign.safety.guard.core.events import GuardedVehicle
from wil_campaign.safety.guard.process.guard_config import GuardConfig, GuardedVehicleConfig
from wil_campaign.safety.guard.process.remote_guard import RemoteGuard
from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.embedded.process.process_settings import ProcessSettings
from wil_campaign.vehicles.errors import VehicleError
from wil_campaign.vehicles.links.link_factory import open_link
from wil_campaign.vehicles.links.link_strings import parse_link
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.setpoints import VelocitySetpoint

NAMES = ("real", "twin")
HZ = 50.0
COMMANDS = 200
TAKEOFFS = 100
STEADY_S = 20.0
TICKS_PER_S = os.sysconf("SC_CLK_TCK")


def tell(what: str, figure: str, mark: str = "") -> None:
    print(f"{what}: {figure}{f' (mark: {mark})' if mark else ''}", flush=True)


def part(values: list[float], share: float) -> float:
    return sorted(values)[min(len(values) - 1, int(share * len(values)))]


def milliseconds(values: list[float]) -> str:
    return f"p50 {part(values, 0.5) * 1e3:.2f} ms, p99 {part(values, 0.99) * 1e3:.2f} ms"


def cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS_PER_S


def settings(name: str, port: int) -> ProcessSettings:
    number = NAMES.index(name) + 1
    return ProcessSettings(
        autopilot="px4",
        link=f"udpout://127.0.0.1:{port}",
        seed=number,
        system_id=number,
        end_with_stdin=True,
    )


def program(name: str, port: int) -> list[str]:
    return [
        sys.executable,
        "-m",
        "wil_campaign.vehicles.embedded",
        settings(name, port).model_dump_json(),
    ]


def decode_rate() -> None:
    """Frames of a vehicle's telemetry, split and decoded."""
    codec = MavlinkCodec(system_id=1, component_id=1)
    stream = b"".join(
        codec.pack(message)
        for _ in range(20_000)
        for message in (
            mavlink.MAVLink_local_position_ned_message(1, *[0.5] * 6),
            mavlink.MAVLink_attitude_quaternion_message(1, 1.0, *[0.1] * 6),
        )
    )
    chunks = [stream[at : at + 1400] for at in range(0, len(stream), 1400)]
    began_s, count = time.process_time(), 0
    for chunk in chunks:
        count += len(codec.parse(chunk))
    rate = count / (time.process_time() - began_s)
    tell("decoded", f"{rate / 1e3:.0f} k messages a second of one core")


async def wrong_port() -> None:
    """Nobody speaks there."""
    began_s = time.monotonic()
    link = open_link(parse_link(f"udpin://127.0.0.1:{free_port()}"))
    try:
        async with Driver(name="real", link=link) as driver:
            await driver.identify(5.0)
    except VehicleError:
        tell("wrong port is reported after", f"{time.monotonic() - began_s:.2f} s", "6 s")


async def identify_time() -> None:
    """A vehicle that speaks already, over UDP."""
    taken = []
    for _ in range(5):
        port = free_port()
        process = await asyncio.create_subprocess_exec(
            *program("real", port), stdin=asyncio.subprocess.PIPE
        )
        await asyncio.sleep(4.0)
        began_s = time.monotonic()
        link = open_link(parse_link(f"udpin://127.0.0.1:{port}"))
        async with Driver(name="real", link=link) as driver:
            await driver.identify(10.0)
            taken.append(time.monotonic() - began_s)
        process.terminate()
        await process.wait()
    tell("identified after", f"at most {max(taken):.2f} s in {len(taken)}", "1.5 s")


class Pair:
    """Two drivers, the guard between, and when commands were on the wire."""

    guard: RemoteGuard

    def __init__(self) -> None:
        self.drivers: dict[str, Driver] = {}
        self.wire: list[tuple[str, float, bytes]] = []

    @contextlib.asynccontextmanager
    async def open(self, folder: str) -> AsyncIterator["Pair"]:
        guard_config = GuardConfig(
            run="bench",
            folder=folder,
            epoch_s=time.time() - asyncio.get_running_loop().time(),
            vehicles={
                name: GuardedVehicleConfig(
                    vehicle=GuardedVehicle(
                        autopilot=autopilot_named("px4"), target=MavlinkTarget(number + 1)
                    )
                )
                for number, name in enumerate(NAMES)
            },
        )
        guard = RemoteGuard(
            guard_config=guard_config, record=lambda *frame: self.wire.append(frame)
        )
        async with contextlib.AsyncExitStack() as stack:
            self.guard = await stack.enter_async_context(guard)
            for name in NAMES:
                await guard.start(name, program(name, guard.port(name)))
                driver = Driver(name=name, link=guard.link(name))
                self.drivers[name] = await stack.enter_async_context(driver)
            for driver in self.drivers.values():
                await driver.identify(20.0)
            for driver in self.drivers.values():
                await driver.ready(60.0)
            yield self


async def command_latency(pair: Pair) -> None:
    driver, taken = pair.drivers["real"], []
    for _ in range(COMMANDS):
        began_s = time.perf_counter()
        await driver.parameters.get("COM_OF_LOSS_T")
        taken.append(time.perf_counter() - began_s)
        await asyncio.sleep(0.01)
    tell("question and answer through driver, guard and vehicle", milliseconds(taken))


async def takeoff_skew(pair: Pair) -> None:
    """Refused, for they are not armed; what counts is when the commands left."""
    skews = []
    for _ in range(TAKEOFFS):
        pair.wire.clear()
        asked = [driver.begin_takeoff(2.0) for driver in pair.drivers.values()]
        await asyncio.gather(*asked, return_exceptions=True)
        sent = {name: t_s for name, t_s, _ in reversed(pair.wire)}
        if len(sent) == len(NAMES):
            skews.append(abs(sent["real"] - sent["twin"]))
    tell(f"takeoff commands leave apart ({len(skews)})", milliseconds(skews), "p99 below 5 ms")


async def steady(pair: Pair) -> None:
    """Telemetry and setpoints at 50 Hz for both: what the paths cost, and how even they are."""
    sent_s: list[float] = []
    still = VelocitySetpoint((0.0, 0.0, 0.0))
    loop = asyncio.get_running_loop()
    before = cpu_s(os.getpid()), cpu_s(pair.guard.pid), loop.time()
    for tick in range(round(STEADY_S * HZ)):
        await asyncio.sleep(max(0.0, before[2] + tick / HZ - loop.time()))
        for driver in pair.drivers.values():
            driver.send(still)
        sent_s.append(loop.time())
    elapsed_s = loop.time() - before[2]
    own = (cpu_s(os.getpid()) - before[0]) / elapsed_s
    guard = (cpu_s(pair.guard.pid) - before[1]) / elapsed_s
    late = [abs(b - a - 1.0 / HZ) for a, b in itertools.pairwise(sent_s)]
    tell("setpoints at 50 Hz, off their period by", milliseconds(late))
    tell(
        "CPU of a pair at 50 Hz, drivers and guard together",
        f"{(own + guard) * 100:.1f} % of a core ({own * 100:.1f} + {guard * 100:.1f})",
        "below 6 %",
    )


async def all_of_it() -> None:
    await wrong_port()
    await identify_time()
    with tempfile.TemporaryDirectory() as folder:
        async with Pair().open(folder) as pair:
            await command_latency(pair)
            await takeoff_skew(pair)
            await steady(pair)


if __name__ == "__main__":
    print(f"load: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    decode_rate()
    asyncio.run(all_of_it())
