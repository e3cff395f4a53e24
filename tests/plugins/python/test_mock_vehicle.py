"""A mock vehicle for anybody's tests: unmodified clients connect, and nothing of it outlives them.

The sessions of pytest are processes of their own, with the plugin as installed.
"""

import asyncio
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pytest
from pymavlink import mavutil

import wil_campaign
from tests.plugins.python.test_python_docs import BLOCKS
from wil_campaign.vehicles.faults import FaultTextError

WITHIN_S = 30.0


def wait(condition: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + WITHIN_S
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.02)


def acknowledgement(link: Any, command: int) -> int:
    while True:
        message = link.recv_match(type="COMMAND_ACK", blocking=True, timeout=WITHIN_S)
        assert message is not None
        if message.command == command:
            return int(message.result)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"autopilot": "px5"}, "there is no autopilot 'px5'"),
        ({"profile": "caeg"}, "no profile 'caeg'"),
        ({"speed": 0}, "speed: "),
        ({"system_id": 300}, "system_id: "),
        ({"link": "udp:14540"}, "link 'udp:14540' cannot be read"),
        ({"link": "memory://"}, "a mock vehicle is at udp or tcp"),
        ({"parameters": {"MIS_TAKEOF_ALT": 3}}, "did you mean 'MIS_TAKEOFF_ALT'?"),
        ({"faults": "motor 9 0"}, "'motor 9 0' is not a fault"),
        ({"faults": ["motor 9 0"]}, "'motor 9 0' is not a fault"),
        ({"faults": ["mute", "camera stop@3"]}, "a mock vehicle has no camera"),
    ],
)
def test_a_wrong_argument_is_refused_in_words(given: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said.replace("?", r"\?")):
        wil_campaign.mock_vehicle(**{"autopilot": "px4", **given})


def test_a_world_that_is_missing_is_bad_input() -> None:
    with pytest.raises(wil_campaign.BadInput, match="cannot be read"):
        wil_campaign.mock_vehicle("px4", world="nowhere.yaml")


async def test_pymavlink_finds_it_in_an_event_loop_and_faults_act() -> None:
    async with wil_campaign.mock_vehicle("ardupilot", faults=["mute"]) as vehicle:
        link = mavutil.mavlink_connection(vehicle.device)
        await asyncio.to_thread(wait, lambda: link.wait_heartbeat(timeout=1.5) is None)
        vehicle.fault("unmute")
        heartbeat = link.wait_heartbeat(timeout=WITHIN_S)
        assert heartbeat.autopilot == 3
        link.set_mode_apm(4)
        assert acknowledgement(link, 176) == 0
        link.arducopter_arm()
        assert acknowledgement(link, 400) == 0
        link.close()
        with pytest.raises(FaultTextError):
            vehicle.fault("motor 9")
        with pytest.raises(FaultTextError, match="no camera"):
            vehicle.fault("camera stop")
        pid = vehicle.pid
        vehicle.fault("mute@0+0.2")
        await asyncio.to_thread(wait, lambda: "fault ended: mute@0+0.2" in vehicle.output)
        vehicle.fault("kill")
        await asyncio.to_thread(wait, lambda: vehicle.pid is None)
        with pytest.raises(wil_campaign.MockVehicleError, match="does not run"):
            vehicle.fault("mute")
    assert pid is not None
    assert not psutil.pid_exists(pid)
    assert "COMMAND_ACK command 400 result 0" in vehicle.output


def test_a_port_that_is_taken_is_named() -> None:
    with socket.create_server(("127.0.0.1", 0)) as holder:
        port = holder.getsockname()[1]
        mock = wil_campaign.mock_vehicle("px4", link=f"tcpin://127.0.0.1:{port}")
        with pytest.raises(wil_campaign.MockVehicleError, match=f"port {port} is in use"):
            mock.start()
    assert mock.pid is None


ARMED_BY_MAVSDK = """
import signal, time, wil_campaign
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action import Action
from mavsdk.plugins.telemetry import Telemetry

signal.alarm(100)
with wil_campaign.mock_vehicle("px4", system_id=7) as vehicle:
    ground = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    assert ground.add_any_connection(vehicle.url) == 0
    system = ground.first_autopilot(30.0)
    telemetry = Telemetry(system)
    while not telemetry.health_all_ok():
        time.sleep(0.02)
    Action(system).arm()
    while not telemetry.armed():
        time.sleep(0.02)
    print(system.get_system_id(), vehicle.pid, flush=True)
    time.sleep(60)
"""


def test_mavsdk_arms_it_and_it_ends_with_the_program_however_that_ends() -> None:
    with subprocess.Popen(  # noqa: S603 - our own interpreter
        [sys.executable, "-c", ARMED_BY_MAVSDK], stdout=subprocess.PIPE
    ) as program:
        assert program.stdout is not None
        system_id, pid = map(int, program.stdout.readline().split())
        assert system_id == 7
        assert psutil.pid_exists(pid)
        program.kill()
    wait(lambda: not psutil.pid_exists(pid) or psutil.Process(pid).status() == "zombie")


def test_a_mock_vehicle_that_ends_by_itself_is_an_error_of_the_block() -> None:
    vehicle = wil_campaign.mock_vehicle("px4")
    vehicle.start()
    assert vehicle.pid is not None
    os.kill(vehicle.pid, signal.SIGKILL)
    wait(lambda: vehicle.pid is None)
    with pytest.raises(wil_campaign.MockVehicleError, match="while it was used"):
        vehicle.stop()


def test_the_fixture_in_a_session_of_pytest(pytester: pytest.Pytester) -> None:
    (page,) = (text for text in BLOCKS if "def test_the_vehicle_arms" in text)
    pytester.makeini("[pytest]\nasyncio_default_fixture_loop_scope = function\n")
    pytester.makepyfile(
        test_page=page,
        test_more="""
            from pathlib import Path

            from pymavlink import mavutil

            def test_that_fails(mock_vehicle):
                vehicles = [mock_vehicle("px4"), mock_vehicle("ardupilot")]
                link = mavutil.mavlink_connection(vehicles[1].device)
                assert link.wait_heartbeat(timeout=30)
                Path("pids").write_text(" ".join(str(one.pid) for one in vehicles))
                assert not "of the test"

            def test_wrong(mock_vehicle):
                mock_vehicle("px4", parameters={"MIS_TAKEOF_ALT": 3})
        """,
    )
    result = pytester.runpytest_subprocess(
        *("-p", "no:cacheprovider", "-p", "no:wil-campaign"),
        *("-p", "wil_campaign.plugins.pytest.pytest_plugin", "-n", "2"),
    )
    result.assert_outcomes(passed=1, failed=2)
    result.stdout.fnmatch_lines(
        [
            "*- mock ardupilot at tcpout://127.0.0.1:* -*",
            "*STATUSTEXT 6 ArduPilot Ready*",
        ]
    )
    result.stdout.fnmatch_lines(["*mock_vehicle('px4'): the embedded px4 has no parameter*"])
    pids = [int(pid) for pid in Path(pytester.path, "pids").read_text().split()]
    assert len(pids) == 2
    assert not any(map(psutil.pid_exists, pids))
