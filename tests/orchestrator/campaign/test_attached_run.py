"""Vehicles that are attached and launched, flown by the program: the wall clock runs."""

import asyncio
import json
import socket
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import psutil
import pytest

from tests.faults.inspection import processes_of
from tests.orchestrator.sitl_programs import make_arducopter, make_px4_build, make_tree
from tests.orchestrator.wall_runs import SHORT, Program, lines, stages
from tests.ports import free_port
from tests.vehicles.embedded.running_vehicle import running_vehicle
from wil_campaign.foundation.processes.identity import ProcessId
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.embedded.process.process_settings import ProcessSettings
from wil_campaign.vehicles.links.link_factory import open_link
from wil_campaign.vehicles.links.link_strings import parse_link

TRUTHS = (("px4", "HIL_STATE_QUATERNION"), ("ardupilot", "SIM_STATE"))


def await_datagram(port: int) -> None:
    """Wait for the first datagram at a port: the process of the vehicle that sends there is up."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as here:
        here.bind(("127.0.0.1", port))
        here.settimeout(90.0)
        here.recv(2048)


def await_listening(pid: int, port: int) -> None:
    """Wait until a process listens at a TCP port, without a connection: it may serve but one."""
    for _ in range(900):
        sockets = psutil.Process(pid).net_connections("tcp")
        if any(one.status == "LISTEN" and one.laddr.port == port for one in sockets):
            return
        time.sleep(0.1)
    raise TimeoutError(port)


@asynccontextmanager
async def outside(link: str, autopilot: str) -> AsyncIterator[None]:
    """A vehicle that is there before the program is, and after it."""
    settings = ProcessSettings(autopilot=autopilot, link=link, seed=1, running_s=60.0)
    async with running_vehicle(settings) as process:
        port = int(link.rpartition(":")[2])
        if link.startswith("udpout:"):
            await asyncio.to_thread(await_datagram, port)
        elif link.startswith("tcpin:"):
            await asyncio.to_thread(await_listening, process.pid, port)
        yield


def words(**sets: str) -> list[str]:
    return [
        word
        for key, value in sets.items()
        for word in ("--set", f"{key.replace('__', '.')}={value}")
    ]


@pytest.fixture(autouse=True)
def _own_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


async def test_an_attached_px4_and_a_launched_arducopter_fly_as_a_pair(tmp_path: Path) -> None:
    port = free_port()
    binary = make_arducopter(tmp_path)
    sets = words(
        vehicles__real__link=f"udpin://127.0.0.1:{port}",
        vehicles__real__pose_source="mavlink",
        vehicles__real__params="{COM_OF_LOSS_T: 2.5}",
        vehicles__twin__autopilot="ardupilot",
        vehicles__twin__link=f"{{launch: ardupilot, binary: {binary}}}",
        vehicles__twin__params="{GUID_TIMEOUT: 4.0}",
        record__vehicle_logs="true",
        sync__takeoff_tolerance_m="0.3",
        preflight__failsafe="set",
    )
    arguments = ("--mode", "wil", "--json", "--arm-real", *SHORT, *sets)
    async with outside(f"udpout://127.0.0.1:{port}", "px4"):
        async with Program(tmp_path / "out", *arguments) as program:
            landed = await program.end()
        assert landed.code == 0, landed.why
        summary = json.loads(landed.out)
        folder = program.run_folder()
        (run,) = summary["runs"]
        assert (run["verdict"], run["reason"]) == ("PASS", "")
        await _is_as_before(port)
    assert (summary["real_kind"], summary["surrogate"]) == ("sitl", False)
    assert summary["runs"][0]["mixing"]["registration_error_px"] is None
    assert landed.err.startswith(
        "real: px4 1.18.0-beta quadrotor, system 1, a simulation, on udpin"
    )
    assert {"real-0.ulg", "twin-1.bin"} <= {file.name for file in folder.iterdir()}
    assert stages(folder)[-2:] == ["landed", "end"]
    fences = [line for line in lines(folder / "log.jsonl") if line["event"] == "fence"]
    assert {line["vehicle"] for line in fences} == {"real", "twin"}
    started = [line for line in lines(folder / "guard.jsonl") if line["event"] == "started"]
    assert [line["vehicle"] for line in started] == ["twin"]
    assert ProcessId.of(started[0]["pid"]) is None
    assert "SERIAL0 on TCP port" in (folder / "twin-sitl" / "output.txt").read_text()


async def _is_as_before(port: int) -> None:
    """The attached vehicle has its own parameters and its own (no) fence again."""
    link = open_link(parse_link(f"udpin://127.0.0.1:{port}"))
    async with Driver(name="real", link=link) as driver:
        await driver.identify(10.0)
        assert await driver.parameters.get("COM_OF_LOSS_T") == 1.0
        assert await driver.parameters.get("GF_ACTION") == 2
        assert await driver.parameters.get("NAV_DLL_ACT") == 0
        assert await driver.parameters.get("RTL_RETURN_ALT") == 30.0
        assert await driver.onboard.fences.read() == ()


@pytest.mark.no_turn("flies nothing")
async def test_no_arm_tries_everything_and_arms_nothing(tmp_path: Path) -> None:
    build = make_px4_build(tmp_path)
    port = free_port()
    sets = words(
        vehicles__real__link=f"tcpout://127.0.0.1:{port}",
        vehicles__real__pose_source="mavlink",
        vehicles__twin__link=f"{{launch: px4, build: {build}}}",
        vehicles__twin__gps="false",
        preflight__failsafe="set",
    )
    arguments = ("--mode", "wil", "--json", "--no-arm", *sets)
    async with (
        outside(f"tcpin://127.0.0.1:{port}", "px4"),
        Program(tmp_path / "out", *arguments) as one,
    ):
        tried = await one.end()
    assert tried.code == 5, tried.why
    summary = json.loads(tried.out)
    (run,) = summary["runs"]
    assert run["reason"] == "not armed, as --no-arm asks; everything up to that works"
    assert (run["required"], summary["accepted"]) == (False, None)
    events = lines(one.run_folder() / "log.jsonl")
    assert not [line for line in events if line.get("kind") == "armed"]
    assert {line["vehicle"] for line in events if line["event"] == "fence"} == {"real", "twin"}
    checks = {(line["check"], line["vehicle"]) for line in events if line["event"] == "preflight"}
    assert ("gps", "real") in checks
    assert ("gps", "twin") not in checks


@pytest.mark.no_turn("flies nothing")
@pytest.mark.parametrize(("firmware", "message"), TRUTHS)
async def test_an_attached_simulation_that_offers_its_ground_truth_is_judged_by_it(
    tmp_path: Path, firmware: str, message: str
) -> None:
    port = free_port()
    sets = words(
        vehicles__real__link=f"tcpout://127.0.0.1:{port}",
        vehicles__real__autopilot=firmware,
        vehicles__real__pose_source="null",
        preflight__failsafe="set",
    )
    arguments = ("--case", "large", "--mode", "wil", "--json", "--no-arm", *sets)
    async with (
        outside(f"tcpin://127.0.0.1:{port}", firmware),
        Program(tmp_path / "out", *arguments) as one,
    ):
        tried = await one.end()
    assert tried.code == 5, tried.why
    assert f"real: judged by its simulator's ground truth ({message}); " in tried.err
    flown = json.loads((one.run_folder().parents[2] / "campaign.json").read_text())
    assert flown["options"]["set"][-1] == "vehicles.real.pose_source=simulator"
    noted = [line for line in lines(one.run_folder() / "log.jsonl") if line["event"] == "preflight"]
    assert "ground_truth" in [line["check"] for line in noted]


@pytest.mark.no_turn("flies nothing")
async def test_a_simulator_that_dies_at_its_start_is_an_error_with_its_words(
    tmp_path: Path,
) -> None:
    make_tree(tmp_path)
    binary = tmp_path / "arducopter"
    binary.write_text("#!/bin/sh\necho 'PANIC: no such frame'\nexit 3\n")
    binary.chmod(0o755)
    sets = words(
        vehicles__twin__autopilot="ardupilot",
        vehicles__twin__link=f"{{launch: ardupilot, binary: {binary}}}",
    )
    async with Program(tmp_path / "out", "--mode", "sim", "--json", *sets) as program:
        landed = await program.end()
        assert list((program.runtime / "wil-campaign").iterdir()) == []
    assert landed.code == 3, landed.why
    (run,) = json.loads(landed.out)["runs"]
    assert run["verdict"] == "ERROR"
    assert "PANIC: no such frame" in run["reason"]


async def test_one_of_two_campaigns_at_one_vehicles_port_flies_and_the_other_says_why(
    tmp_path: Path,
) -> None:
    port = free_port()
    sets = words(
        vehicles__real__link=f"udpin://127.0.0.1:{port}",
        vehicles__real__pose_source="mavlink",
        vehicles__real__params="{COM_OF_LOSS_T: 2.5}",
        preflight__failsafe="set",
    )
    arguments = ("--mode", "wil", "--json", "--arm-real", *SHORT, *sets)
    async with outside(f"udpout://127.0.0.1:{port}", "px4"):
        async with Program(tmp_path / "out", *arguments) as first:
            await first.stage("takeoff")
            # In the same folder for results, and with the same one for sockets.
            second = Program(tmp_path / "out", *arguments, runtime=first.runtime)
            await second.__aenter__()  # its end would remove the folder of both
            refused = await second.end()
            landed = await first.end()
            left = [*processes_of(first.runtime), *first.runtime.glob("wil-campaign/*")]
        assert refused.code == 3, refused.why
        assert f"udpin://127.0.0.1:{port}" in refused.err, refused.why
        assert landed.code == 0, landed.why
        assert left == []
        assert (
            len(list((tmp_path / "out" / "gate").iterdir())) == 1
        )  # nothing is made for who is refused
