"""A program of the user's as pilot: its environment, its setpoints, its end."""

import asyncio
import json
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.orchestrator.external.rigs import FakeStation, until
from wil_campaign.campaigns.setup.autonomy_under_test import UnderTest
from wil_campaign.campaigns.values.autonomy_limits import AutonomyLimits
from wil_campaign.campaigns.values.sensor_setups import CameraSetup
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.plugins.programs.program_autonomy import ProgramAutonomy
from wil_campaign.plugins.programs.program_runner import ProgramRunner
from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.links.tapped import TappedLink
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.readings import CameraReading
from wil_campaign.worlds.camera import CameraMount, Intrinsics

CAMERA = CameraSetup(
    name="camera", rate_hz=10.0, intrinsics=Intrinsics.from_fov(64, 48, 1.2), mount=CameraMount()
)
TELLS = """
import json, os
told = {name: value for name, value in os.environ.items() if name.startswith("WIL_")}
json.dump(told, open("env.part", "w"))
os.replace("env.part", "env.json")
"""
FLIES = """
import os, socket, sys
from pymavlink.dialects.v20 import ardupilotmega as mavlink
host, port = os.environ["WIL_MAVLINK_URL"].removeprefix("udpout://").split(":")
link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
link.settimeout(0.05)
mav = mavlink.MAVLink(None, srcSystem=200)
parser = mavlink.MAVLink(None)
while True:
    link.sendto(mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 1, 0b110111000111, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0).pack(mav), (host, int(port)))
    try:
        data = link.recv(2048)
    except TimeoutError:
        continue
    for message in parser.parse_buffer(data) or []:
        if message.get_type() == "STATUSTEXT" and message.text == "enough":
            sys.exit(int(sys.argv[1]))
"""

HOARDS = """
import os, subprocess, sys, time
hoard = '''
import os, time
while not os.path.exists("child"):
    time.sleep(0.01)
kept = b'x' * 400_000_000
time.sleep(600)
'''
child = subprocess.Popen([sys.executable, "-c", hoard])
open("child.part", "w").write(str(child.pid))
os.replace("child.part", "child")
time.sleep(600)
"""

STARTS = """
import os, subprocess, sys, time
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
open("child.part", "w").write(str(child.pid))
os.replace("child.part", "child")
time.sleep(600)
"""


class Rig:
    """A pilot, its vehicle's end of the link, and what the run hears."""

    def __init__(self, folder: Path, command: list[str]) -> None:
        self.context = FakeStation()
        far, near = memory_pair(latency_s=0.0, name="vehicle")
        self.far, self.link = far, TappedLink(near)
        self.codec = MavlinkCodec(system_id=1, component_id=1)
        self.got: list[Any] = []
        self.far.receive(lambda data, _: self.got.extend(self.codec.parse(data)))
        self.run_state = RunState(time=asyncio.get_running_loop().time)
        self.runner = ProgramRunner(
            under_test=UnderTest(
                use=None,
                folder=folder,
                rate_hz=20.0,
                parameters={"speed_m_s": 0.8},
                goal={"altitude_m": 1.2},
                limits=AutonomyLimits(memory_mb=300.0),
            ),
            program=ProgramAutonomy(tuple(command)),
            context=cast("VehicleContext", self.context),
            link=self.link,
            target=MavlinkTarget(1),
            camera=CAMERA,
            run_state=self.run_state,
            folder=folder,
            seed=7,
        )

    def say(self, text: str) -> None:
        self.far.write(self.codec.pack(mavlink.MAVLink_statustext_message(6, text.encode())))


@asynccontextmanager
async def rig(folder: Path, *command: str) -> AsyncIterator[Rig]:
    one = Rig(folder, [sys.executable, *command])
    async with one.far, one.link, one.runner:
        yield one


async def test_it_gets_where_to_fly_what_to_see_and_what_for(tmp_path: Path) -> None:
    async with rig(tmp_path, "-c", TELLS):
        await until((tmp_path / "env.json").exists)
        sdp = (tmp_path / "real-perceived.sdp").read_text()
    told = json.loads((tmp_path / "env.json").read_text())
    assert told["WIL_MAVLINK_URL"].startswith("udpout://127.0.0.1:")
    assert told["WIL_VIDEO_URL"] == str(tmp_path / "real-perceived.sdp")
    assert "H264" in sdp
    assert json.loads(told["WIL_GOAL"]) == {"altitude_m": 1.2}
    assert json.loads(told["WIL_PARAMETERS"]) == {"speed_m_s": 0.8}
    assert (told["WIL_VEHICLE"], told["WIL_SYSTEM_ID"], told["WIL_SEED"]) == ("real", "1", "7")


async def test_its_setpoints_pass_from_the_goal_on_and_its_end_is_being_done(
    tmp_path: Path,
) -> None:
    first: list[str] = []
    async with rig(tmp_path, "-c", FLIES, "0") as one:
        runner = one.runner
        runner.on_first_setpoint(lambda name, _: first.append(name))
        await until(lambda: runner.result.refused >= 3)
        assert one.got == []
        flying = asyncio.create_task(runner.fly())
        await until(lambda: len(one.got) >= 3)
        assert first == ["real"]
        assert one.context.driver.calls == ["hand_over"]
        one.say("enough")
        async with asyncio.timeout(20.0):
            await runner.done.wait()
        assert one.context.driver.calls == ["hand_over", "keep_still"]
        flying.cancel()
        await asyncio.wait([flying])
    assert {message.get_srcSystem() for message in one.got} == {200}
    assert one.run_state.decisive == []
    assert runner.result.exit == "ended by itself, exit code 0"


async def test_a_crash_in_flight_fails_the_run_with_the_programs_last_output(
    tmp_path: Path,
) -> None:
    async with rig(tmp_path, "-c", "print('no such gate'); raise SystemExit(3)") as one:
        flying = asyncio.create_task(one.runner.fly())
        await until(lambda: bool(one.run_state.decisive))
        flying.cancel()
        await asyncio.wait([flying])
    (event,) = one.run_state.decisive
    assert (event.kind, event.source) == ("FAIL", "autonomy/real")
    assert event.text == "the autonomy of real ended by itself, exit code 3: no such gate"


async def test_a_program_whose_child_eats_memory_is_ended_and_the_run_an_error(
    tmp_path: Path,
) -> None:
    async with rig(tmp_path, "-c", HOARDS) as one:
        await until(lambda: bool(one.run_state.decisive))
        child = int((tmp_path / "child").read_text())
        await until(lambda: not runs(child))
    (event,) = one.run_state.decisive
    assert (event.kind, event.source) == ("ERROR", "autonomy/real")
    said = "the autonomy of real uses too much memory: the program and its children hold "
    assert event.text.startswith(said)
    assert "autonomy.limits.memory_mb is 300" in event.text


def image(k: int, intrinsics: Intrinsics, sensor: str = "camera") -> CameraReading:
    size = (intrinsics.height_px, intrinsics.width_px, 3)
    pixels = np.full(size, 80, np.uint8)
    return CameraReading(k / 10, k / 10, k, "mixed", pixels, intrinsics, sensor=sensor)


async def flown(one: Rig, count: int, intrinsics: Intrinsics) -> None:
    """Fly the goal while images come: of the program's camera, and of another one."""
    flying = asyncio.create_task(one.runner.fly())
    await asyncio.sleep(0)  # it has begun
    for k in range(count):
        one.runner.perceive(image(k, intrinsics))
        one.runner.perceive(image(k, intrinsics, "down"))
        await until(partial(is_settled, one, k + 1))
    flying.cancel()
    await asyncio.wait([flying])


def is_settled(one: Rig, count: int) -> bool:
    """Return whether it is known what became of so many images."""
    video = one.runner.result.video
    assert video is not None
    return video.delivered + video.failed + video.dropped == count


async def test_it_is_sent_the_images_of_its_camera_and_the_result_counts_them(
    tmp_path: Path,
) -> None:
    async with rig(tmp_path, "-c", STARTS) as one:
        await flown(one, 5, CAMERA.intrinsics)
    assert one.run_state.decisive == []
    video = one.runner.result.video
    assert video is not None
    assert (video.offered, video.delivered, video.failed) == (5, 5, 0)


async def test_a_program_whose_images_are_refused_makes_the_run_invalid(tmp_path: Path) -> None:
    async with rig(tmp_path, "-c", STARTS) as one:
        await flown(one, 5, Intrinsics.from_fov(32, 24, 1.2))
    (event,) = one.run_state.decisive
    assert (event.kind, event.source) == ("INVALID", "video/real")
    assert event.text.startswith(
        "the autonomy of real was blind: only 0 of 5 images of 'camera' were sent to its program: "
    )
    assert event.text.endswith("its size 32x24 does not fit the stream of 64x48")


async def test_a_program_that_is_blind_does_not_fly_on(tmp_path: Path) -> None:
    async with rig(tmp_path, "-c", STARTS) as one:
        flying = asyncio.create_task(one.runner.fly())
        await asyncio.sleep(0)  # it has begun
        one.runner.perceive(image(0, Intrinsics.from_fov(32, 24, 1.2)))
        await until(one.run_state.over.is_set)
        flying.cancel()
        await asyncio.wait([flying])
    assert [event.kind for event in one.run_state.decisive] == ["INVALID"]


@pytest.mark.parametrize("code", ["pass", "import no_such_module"])
async def test_an_end_before_the_goal_was_given_is_an_error(tmp_path: Path, code: str) -> None:
    async with rig(tmp_path, "-c", code) as one:
        await until(lambda: bool(one.run_state.decisive))
    (event,) = one.run_state.decisive
    assert event.kind == "ERROR", "the test did not take place"
    assert "before it was given the goal" in event.text
    assert ("no_such_module" in event.text) is (code != "pass")


async def test_it_ends_with_the_run_with_all_that_it_started(tmp_path: Path) -> None:
    async with rig(tmp_path, "-c", STARTS) as one:
        await until((tmp_path / "child").exists)
    assert one.run_state.decisive == []
    assert "ended with the run" in one.runner.result.exit
    assert not runs(int((tmp_path / "child").read_text()))


def runs(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
