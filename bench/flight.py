"""How fast campaigns fly: seconds flown per wall second, peak memory of a run, time of --help.

`python bench/flight.py [--repetitions N]`; prints one line per figure. Quote ratios of one run.
"""

import argparse
import asyncio
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from campaigns.expansion.expansion import Options, load_campaign
from orchestrator.model.clock import run_virtual
from orchestrator.run.flight.run import fly
from orchestrator.state.run_setup import RunOrder, RunSetup
from safety.guard.core.operator_command import OperatorCommand
from vehicles.autopilots.autopilot import AutopilotName, MessageRate, Target, own_heartbeat
from vehicles.autopilots.registry import autopilot_named
from vehicles.embedded.physics.config import EmbeddedConfig
from vehicles.embedded.profile import load_profile
from vehicles.embedded.vehicle import EmbeddedVehicle
from vehicles.links.memory import memory_pair
from vehicles.mavlink.codec import Codec

ROOT = Path(__file__).parents[1]
_HOVER_S = 120.0
_ESTIMATES = (32, 31)
"""LOCAL_POSITION_NED and ATTITUDE_QUATERNION."""
PROGRAM = [sys.executable, "-m", "orchestrator.cli"]


class Nobody:
    def poll(self) -> OperatorCommand | None:
        return None


def campaign_on_all_cores(repetitions: int) -> None:
    with tempfile.TemporaryDirectory() as out:
        began_s = time.perf_counter()
        done = subprocess.run(  # noqa: S603 - our own program
            [
                *PROGRAM,
                "run",
                str(ROOT / "campaigns/gate.yaml"),
                "--out",
                out,
                "--json",
                "--repetitions",
                str(repetitions),
            ],
            cwd=ROOT,
            check=False,
            capture_output=True,
            text=True,
        )
        wall_s = time.perf_counter() - began_s
    if done.returncode not in {0, 1}:
        sys.exit(f"exit {done.returncode}: {done.stderr}")
    runs = json.loads(done.stdout)["runs"]
    flown_s = sum(run["duration_s"] or 0.0 for run in runs)
    peak_mb = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    print(f"campaign gate, all cores: {len(runs)} runs, {flown_s:.0f} s flown in {wall_s:.1f} s")
    print(f"  flown per wall second: {flown_s / wall_s:.1f} (mark: at least 10)")
    print(f"  peak memory of one process: {peak_mb:.0f} MB (mark: below 600)")


def one_run(name: str, sets: tuple[str, ...], mode: str, mark: str) -> None:
    options = Options(cases=("large",), modes=(mode,), sets=sets)
    plan = load_campaign(ROOT / "campaigns/gate.yaml", options).runs[0]
    best = 0.0
    for _ in range(3):
        with tempfile.TemporaryDirectory() as folder:
            setup = RunSetup.of(RunOrder(plan=plan, folder=Path(folder), clock="virtual"))
            began_s = time.process_time()
            result = fly(setup, lambda _: None, Nobody())
            best = max(best, (result.duration_s or 0.0) / (time.process_time() - began_s))
    print(f"{name}, one core: {best:.1f} s flown per second{mark} ({result.verdict})")


def lone_vehicle(autopilot: AutopilotName) -> None:
    """Have a vehicle hover for two minutes, with estimates at 50 Hz and nobody at its link."""
    rates = [_HOVER_S / run_virtual(_hover_cpu_s(autopilot)) for _ in range(3)]
    print(f"{autopilot} alone, one core: {max(rates):.0f} s flown per second (mark: at least 200)")


async def _hover_cpu_s(autopilot: AutopilotName) -> float:
    """Return the CPU seconds that an embedded vehicle's hover takes."""
    near, far = memory_pair(latency_s=0.003)
    config = EmbeddedConfig(autopilot=autopilot, profile=load_profile("nominal"), running_s=60.0)
    strategy, target = autopilot_named(autopilot), Target(1)
    codec = Codec(system_id=245, component_id=190)
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


def blind_pair() -> None:
    """Have the pair hover for half a minute, without cameras and mixing."""
    options = Options(
        cases=("large",), modes=("wil",), sets=("oracles.reached.required=false", "controls={}")
    )
    plan = load_campaign(ROOT / "campaigns/gate.yaml", options).runs[0]
    rates = []
    for _ in range(3):
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "hover.py").write_text(_HOVER, "utf-8")
            out = Path(folder) / "run"
            out.mkdir()
            setup = _without_cameras(RunOrder(plan=plan, folder=out, clock="virtual"), folder)
            began_s = time.process_time()
            result = fly(setup, lambda _: None, Nobody())
            rates.append((result.duration_s or 0.0) / (time.process_time() - began_s))
    flown = f"{result.duration_s:.0f} s, {result.verdict} {result.reason}"
    print(f"pair without cameras, one core: {max(rates):.1f} (mark: at least 40; {flown})")


def _without_cameras(order: RunOrder, folder: str) -> RunSetup:
    setup = RunSetup.of(order)
    vehicles = tuple(replace(vehicle, sensors=()) for vehicle in setup.vehicles)
    hover = replace(setup.campaign.under_test, use="hover.py:Hover", folder=Path(folder))
    campaign = replace(
        setup.campaign,
        recipe=None,
        under_test=hover,
        vehicles={vehicle.name: vehicle for vehicle in vehicles},
    )
    return replace(setup, campaign=campaign, vehicles=vehicles)


_HOVER = """
from vehicles.autonomy import Command
from vehicles.setpoints import VelocitySetpoint

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


def help_time() -> None:
    times = []
    for _ in range(5):
        began_s = time.perf_counter()
        subprocess.run(  # noqa: S603 - our own program
            [*PROGRAM, "--help"], cwd=ROOT, check=True, capture_output=True
        )
        times.append(time.perf_counter() - began_s)
    print(f"wil-campaign --help: {sorted(times)[2]:.2f} s (mark: below 0.3)")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repetitions", type=int, default=5)
    repetitions = parser.parse_args().repetitions
    parts: tuple[Callable[[], None], ...] = (
        help_time,
        lambda: lone_vehicle("px4"),
        lambda: lone_vehicle("ardupilot"),
        blind_pair,
        lambda: one_run("run in mode sim", (), "sim", ""),
        lambda: one_run("run in mode wil", (), "wil", ""),
        lambda: campaign_on_all_cores(repetitions),
    )
    for part in parts:
        part()


if __name__ == "__main__":
    main()
