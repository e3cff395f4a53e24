"""How fast campaigns fly, and what they cost: a table of figures beside aims and floors.

`python -m bench.flight [--repetitions N]`. Quote ratios of one run on one machine: load changes
all figures, of a busy machine by half. Flown seconds are of the run clock, from takeoff to
disarming; CPU seconds those of one process. Beside our figures, in the same run: PyFlyt's QuadX
with and without its camera, where PyFlyt is installed. It is what a user of Python would take
instead, and has no autopilot, MAVLink, guard, judge or recording.
"""

import argparse
import asyncio
import contextlib
import importlib
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before NumPy is imported, as in workers

import cv2
import numpy as np

from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.foundation.processes.child import ChildProcess
from wil_campaign.foundation.processes.feed_socket import feed_environment, feed_pair
from wil_campaign.foundation.processes.fork_server import ForkServer
from wil_campaign.orchestrator.run.flight.run import fly_one_run
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.vehicles.autopilots.autopilot import (
    MavlinkTarget,
    MessageRate,
    own_heartbeat,
)
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.embedded.physics.config import EmbeddedConfig, Physics
from wil_campaign.vehicles.embedded.process.embedded_launch import FeedClient
from wil_campaign.vehicles.embedded.process.process_settings import ProcessSettings
from wil_campaign.vehicles.embedded.profile import load_profile
from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.vehicle_server_process import (
    VehicleServerProcess,
    vehicle_program,
)

ROOT = Path(__file__).parents[1]
_HOVER_S = 120.0
_TRIALS = 3
_STARTS = 8
_ESTIMATES = (32, 31)
"""LOCAL_POSITION_NED and ATTITUDE_QUATERNION."""
_PER_CPU = "flown s / CPU s"
PROGRAM = [sys.executable, "-m", "wil_campaign"]


@dataclass(frozen=True, slots=True)
class Figure:
    """A measured figure: its best of several trials, and their median.

    aim: what it is to be. floor: what is left when all of our own Python is compiled away, an
    estimate from the cost of JSBSim, images and JPEGs; "" for none.
    """

    name: str
    best: float
    median: float
    unit: str
    aim: str = ""
    floor: str = ""

    @classmethod
    def of(
        cls,
        name: str,
        values: list[float],
        unit: str,
        *,
        aim: str = "",
        floor: str = "",
        least: bool = False,
    ) -> "Figure":
        """Return the figure of trials. least: whether the least is the best."""
        best = min(values) if least else max(values)
        return cls(name, best, statistics.median(values), unit, aim, floor)

    @property
    def row(self) -> tuple[str, ...]:
        """Return the figure's cells."""
        return (self.name, _text(self.best), _text(self.median), self.unit, self.aim, self.floor)


def _text(value: float) -> str:
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


class Nobody:
    def poll(self) -> OperatorCommand | None:
        return None


def campaign_on_all_cores(repetitions: int) -> list[Figure]:
    with tempfile.TemporaryDirectory() as out:
        began_s = time.perf_counter()
        done = subprocess.run(  # noqa: S603 - our own program
            [
                *(*PROGRAM, "run", str(ROOT / "campaigns/gate.yaml")),
                *("--out", out, "--json", "--repetitions", str(repetitions)),
            ],
            cwd=ROOT,
            check=False,
            capture_output=True,
            text=True,
        )
        wall_s = time.perf_counter() - began_s
        files = [one for one in Path(out).rglob("*") if one.is_file()]
        size_mb = sum(file.stat().st_size for file in files) / 1e6
        folders = sum(file.name == "result.json" for file in files)
    if done.returncode not in {0, 1}:
        sys.exit(f"exit {done.returncode}: {done.stderr}")
    runs = json.loads(done.stdout)["runs"]
    flown_s = sum(run["duration_s"] or 0.0 for run in runs)
    peak_mb = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    speed, whose = flown_s / wall_s, f"gate.yaml, {folders} runs with its controls"
    return [
        Figure(f"{whose}, all cores", speed, speed, "flown s / wall s", "18", "30"),
        Figure(f"{whose}: disk", size_mb, size_mb, "MB", "150 of 24 runs"),
        Figure(f"{whose}: largest process", peak_mb, peak_mb, "MB", "600"),
    ]


def table_one() -> list[Figure]:
    """Fly the table of the three scenarios on all cores."""
    with tempfile.TemporaryDirectory() as out:
        began_s = time.perf_counter()
        done = subprocess.run(  # noqa: S603 - our own program
            [*PROGRAM, "run", str(ROOT / "campaigns/table1.yaml"), "--out", out, "--json"],
            cwd=ROOT,
            check=False,
            capture_output=True,
            text=True,
        )
        wall_s = time.perf_counter() - began_s
    if done.returncode not in {0, 1}:
        sys.exit(f"exit {done.returncode}: {done.stderr}")
    runs = len(json.loads(done.stdout)["runs"])
    return [Figure(f"table1.yaml, {runs} runs, all cores", wall_s, wall_s, "s", "150")]


def one_run(mode: str, aim: str, floor: str) -> list[Figure]:
    plan = load_campaign(
        ROOT / "campaigns/gate.yaml", ExpansionOptions(cases=("large",), modes=(mode,))
    )
    rates, sizes = [], []
    for _ in range(_TRIALS):
        with tempfile.TemporaryDirectory() as folder:
            order = RunOrder(plan=plan.runs[0], folder=Path(folder), clock="virtual")
            setup = RunSetup.of(order)
            began_s = time.process_time()
            result = fly_one_run(setup, lambda _: None, Nobody())
            rates.append((result.duration_s or 0.0) / (time.process_time() - began_s))
            sizes.append((Path(folder) / "run.mcap").stat().st_size / 1e6)
    name = f"run in mode {mode} ({result.verdict})"
    return [
        Figure.of(name, rates, _PER_CPU, aim=aim, floor=floor),
        Figure.of(f"{name}: run.mcap", sizes, "MB", least=True),
    ]


def lone_vehicle(autopilot: str, physics: Physics = "jsbsim") -> list[Figure]:
    """Have a vehicle hover for two minutes, with estimates at 50 Hz and nobody at its link."""
    rates = [_HOVER_S / run_virtual(_hover_cpu_s(autopilot, physics)) for _ in range(_TRIALS)]
    floor = "700 (JSBSim alone)" if physics == "jsbsim" else ""
    return [Figure.of(f"{autopilot} alone, {physics}", rates, _PER_CPU, aim="500", floor=floor)]


async def _hover_cpu_s(autopilot: str, physics: Physics) -> float:
    """Return the CPU seconds that an embedded vehicle's hover takes."""
    near, far = memory_pair(latency_s=0.003)
    profile = load_profile("nominal")
    config = EmbeddedConfig(autopilot=autopilot, physics=physics, profile=profile, running_s=60.0)
    strategy, target = autopilot_named(autopilot), MavlinkTarget(1)
    codec = MavlinkCodec(system_id=245, component_id=190)
    plan = [MessageRate(number, 50.0) for number in _ESTIMATES]
    async with far, EmbeddedVehicle(config=config, link=near, seed=1) as vehicle:
        for message in (
            own_heartbeat(),
            *(strategy.request_interval(target, one) for one in plan),
            strategy.set_mode(target, strategy.arming_mode),
            strategy.arm(target),
            strategy.takeoff(target, altitude_m=2.5, ground_amsl_m=488.0),
        ):
            far.write(codec.pack(message))
            await asyncio.sleep(0.2)
        await asyncio.sleep(15.0)
        began_s = time.process_time()
        await asyncio.sleep(_HOVER_S)
        spent_s = time.process_time() - began_s
        if vehicle.truth().on_ground:
            sys.exit(f"{autopilot} did not take off")
    return spent_s


def blind_pair(physics: Physics = "jsbsim") -> list[Figure]:
    """Have the pair hover for half a minute, without cameras and mixing."""
    by = [f"vehicles.{name}.physics={physics}" for name in ("real", "twin")]
    sets = ("oracles.reached.required=false", "controls={}", *by)
    options = ExpansionOptions(cases=("large",), modes=("wil",), sets=sets)
    plan = load_campaign(ROOT / "campaigns/gate.yaml", options).runs[0]
    rates = []
    for _ in range(_TRIALS):
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "hover.py").write_text(_HOVER, "utf-8")
            out = Path(folder) / "run"
            out.mkdir()
            setup = _without_cameras(RunOrder(plan=plan, folder=out, clock="virtual"), folder)
            began_s = time.process_time()
            result = fly_one_run(setup, lambda _: None, Nobody())
            rates.append((result.duration_s or 0.0) / (time.process_time() - began_s))
    name = f"pair without cameras, {physics} ({result.verdict})"
    return [Figure.of(name, rates, _PER_CPU, aim="35, then 60", floor="100")]


def _without_cameras(order: RunOrder, folder: str) -> RunSetup:
    setup = RunSetup.of(order)
    vehicles = tuple(replace(vehicle, sensors=()) for vehicle in setup.vehicles)
    hover = replace(setup.case.under_test, use="hover.py:Hover", folder=Path(folder))
    campaign = replace(
        setup.case,
        recipe=None,
        under_test=hover,
        vehicles={vehicle.name: vehicle for vehicle in vehicles},
    )
    return replace(setup, case=campaign, vehicles=vehicles)


_HOVER = """
from wil_campaign.vehicles.autonomy import Command
from wil_campaign.vehicles.setpoints import VelocitySetpoint

class Hover:
    def __init__(self, *, goal, parameters, seed):
        self.since = None
    def perceive(self, reading):
        pass
    def act(self, telemetry):
        self.since = telemetry.t_s if self.since is None else self.since
        done = telemetry.t_s - self.since > 30.0
        return Command(VelocitySetpoint((0.0, 0.0, 0.0)), done=done)
"""


def command_starts() -> list[Figure]:
    """Measure the CPU of commands that every use begins with."""
    gate = str(ROOT / "campaigns/gate.yaml")
    words = {"--help": ["--help"], "validate gate.yaml": ["validate", gate]}
    figures = []
    for name, arguments in words.items():
        times = []
        for _ in range(_STARTS):
            with _children_cpu_s(times):
                subprocess.run(  # noqa: S603 - our own program
                    [*PROGRAM, *arguments], cwd=ROOT, check=True, capture_output=True
                )
        aim = "0.3" if name == "--help" else ""
        figures.append(Figure.of(f"wil-campaign {name}", times, "CPU s", aim=aim, least=True))
    return figures


def vehicle_starts() -> list[Figure]:
    """Measure the CPU of a vehicle's process to its end at once: started, and forked."""
    return asyncio.run(_vehicle_starts())


async def _vehicle_starts() -> list[Figure]:
    """Return the figures of vehicles that are started, and of those that are forked."""
    settings = ProcessSettings(
        autopilot="px4", link="udpout://127.0.0.1:9", seed=1, end_with_parent=False
    )
    argv = (*vehicle_program(), settings.model_dump_json())
    server = VehicleServerProcess()
    server.start()
    client = ForkServer(os.dup(server.descriptor), vehicle_program())
    figures = []
    for name, by in (("started", None), ("forked", client)):
        times = [await _vehicle_cpu_s(argv, by) for _ in range(_STARTS + 1)]
        # The first fork waits for the imports of the server, and may be a start.
        figures.append(Figure.of(f"vehicle's process, {name}", times[1:], "CPU s", least=True))
    client.close()
    await server.close()
    return figures


async def _vehicle_cpu_s(argv: tuple[str, ...], client: ForkServer | None) -> float:
    """Return the CPU seconds of a vehicle's process until it has sent its first pose."""
    ours, theirs = feed_pair()
    async with FeedClient(source="real", end=ours) as feed:
        with theirs:
            child = ChildProcess(
                argv=argv,
                environment={**os.environ, **feed_environment(theirs.fileno())},
                inherited=(theirs.fileno(),),
            )
            await child.start_by(client)
        await feed.connected.wait()
        spent_s = _cpu_s(Path(f"/proc/{child.pid}"))
        await child.end()
    return spent_s


def _cpu_s(process: Path) -> float:
    fields = (process / "stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextlib.contextmanager
def _children_cpu_s(times: list[float]) -> Iterator[None]:
    """Append the CPU seconds of the child processes that end meanwhile."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    yield
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    times.append(after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)


def pyflyt(*, camera: bool, seconds: float) -> list[Figure]:
    """Have PyFlyt's QuadX hold its position, at 240 Hz of PyBullet; nothing without PyFlyt."""
    try:
        core: Any = importlib.import_module("PyFlyt.core")
    except ImportError:
        return []
    options = {"use_camera": True, "camera_resolution": (480, 640), "camera_fps": 15}
    world = core.Aviary(
        start_pos=np.array([[0.0, 0.0, 1.0]]),
        start_orn=np.zeros((1, 3)),
        drone_type="quadx",
        render=False,
        drone_options=options if camera else {},
    )
    world.set_mode(7)  # position and heading
    world.set_setpoint(0, np.array([0.0, 0.0, 0.0, 1.0]))
    while world.elapsed_time < 1.0:  # its controller is compiled
        world.step()
    from_s, began_s = world.elapsed_time, time.process_time()
    while world.elapsed_time < from_s + seconds:
        world.step()
    rate = (world.elapsed_time - from_s) / (time.process_time() - began_s)
    world.disconnect()
    name = "instead: PyFlyt QuadX" + (", camera 640x480 at 15 Hz" if camera else "")
    return [Figure(name, rate, rate, _PER_CPU)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--only", default="", help="the parts whose names contain this")
    chosen = parser.parse_args()
    cv2.setNumThreads(1)  # runs share the cores by processes
    parts: dict[str, Callable[[], list[Figure]]] = {
        "commands": command_starts,
        "vehicles": vehicle_starts,
        "px4": lambda: lone_vehicle("px4"),
        "ardupilot": lambda: lone_vehicle("ardupilot"),
        "px4 compiled": lambda: lone_vehicle("px4", "compiled"),
        "pair": blind_pair,
        "pair compiled": lambda: blind_pair("compiled"),
        "sim": lambda: one_run("sim", "18", "30"),
        "wil": lambda: one_run("wil", "9", "13"),
        "pyflyt": lambda: pyflyt(camera=False, seconds=20.0),
        "pyflyt camera": lambda: pyflyt(camera=True, seconds=1.0),
        "table1": table_one,
        "campaign": lambda: campaign_on_all_cores(chosen.repetitions),
    }
    print_row(("figure", "best", "median", "unit", "aim", "floor"))
    print_row(("---",) * 6)
    for name, part in parts.items():
        if chosen.only in name:
            for figure in part():
                print_row(figure.row)


def print_row(cells: tuple[str, ...]) -> None:
    """Print a row of the table, in Markdown."""
    print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
