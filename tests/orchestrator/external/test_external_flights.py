"""Whole flights with something outside: a simulator, a stream, a program of the user's."""

import asyncio
import json
import signal
import subprocess
import sys
import textwrap
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from tests.orchestrator.wall_runs import ROOT, SHORT, STAYING, Program
from tests.ports import free_port
from tests.vehicles.sources.pumping import pump
from vehicles.perception.blobs import BlobFinder
from vehicles.perception.hsv import NAMED_COLORS
from vehicles.readings import CameraReading
from vehicles.sources.cameras.camera_factory import live_camera
from worlds.camera import Intrinsics

CAMERA = Intrinsics.from_fov(160, 120, 1.2)


@asynccontextmanager
async def simulator() -> AsyncIterator[tuple[str, "subprocess.Popen[str]"]]:
    """The reference simulator, in a process of its own; gives its address."""
    process = await asyncio.to_thread(
        subprocess.Popen,
        [
            *(sys.executable, "-m", "vehicles.sources.reference_simulator"),
            *("--world", "worlds/gate.yaml", "--bind", "tcp://127.0.0.1:*"),
        ],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    try:
        yield (await asyncio.to_thread(process.stdout.readline)).strip(), process
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def sets(*given: str) -> tuple[str, ...]:
    return tuple(word for one in given for word in ("--set", one))


def drawn_by(address: str, answer_ms: int) -> str:
    source = f"{{address: '{address}', answer_ms: {answer_ms}}}"
    return f"vehicles.twin.sensors.camera.source={source}"


async def watch(port: int, seen: list[CameraReading]) -> None:
    """Keep what a second program sees of the stream."""
    camera = live_camera(
        f"rtp://127.0.0.1:{port}", intrinsics=CAMERA, open_timeout_s=90.0, stall_timeout_s=15.0
    )
    async with camera as source:
        await pump(source, seen.append)


async def test_a_simulator_draws_the_twins_world_and_a_second_program_sees_the_mixture(
    tmp_path: Path,
) -> None:
    port, seen = free_port(), list[CameraReading]()
    async with simulator() as (address, _):
        watching = asyncio.create_task(watch(port, seen))
        given = (
            *(*SHORT, *sets("autonomy.with={speed_m_s: 0.3, for_s: 4}")),
            *sets(drawn_by(address, 3000), f"deliver=[{{rtp: '127.0.0.1:{port}'}}]"),
        )
        async with Program(tmp_path / "out", "--mode", "wil", "--json", *given) as program:
            landed = await program.end()
        watching.cancel()
        await asyncio.wait([watching])
    assert landed.code == 0, landed.why
    summary = json.loads(landed.out)
    (run,) = summary["runs"]
    assert (run["verdict"], run["reason"]) == ("PASS", "")
    assert summary["sensors"] == {"camera": "rendered"}
    (source,) = run["outside"]["sources"]
    assert (source["vehicle"], source["damaged"]) == ("twin", 0)
    assert source["delivered"] > 30
    (outlet,) = run["outside"]["outlets"]
    assert outlet["delivered"] > 30
    assert outlet["failed"] == 0
    assert (program.run_folder() / "camera-perceived.sdp").exists()
    # The gate is nowhere but in the simulator's world.
    finder = BlobFinder(NAMED_COLORS["orange"])
    assert sum(finder.find(reading.image_bgr) is not None for reading in seen) > 10


async def test_a_simulator_that_dies_in_flight_makes_the_run_invalid_and_lands_it(
    tmp_path: Path,
) -> None:
    async with simulator() as (address, process):
        given = (*STAYING, *sets(drawn_by(address, 700)))
        async with Program(tmp_path / "out", "--mode", "wil", "--json", *given) as program:
            await program.stage("goal")
            process.send_signal(signal.SIGKILL)
            landed = await program.end()
    assert landed.code == 3, landed.why
    (run,) = json.loads(landed.out)["runs"]
    assert run["verdict"] == "INVALID"
    assert address in run["reason"]
    assert run["outside"]["sources"][0]["missed"] > 0
    assert {oracle["name"]: oracle["verdict"] for oracle in run["oracles"]}["landed"] == "PASS"


FLY = """
    import json, os, socket, sys, time
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    host, port = os.environ["WIL_MAVLINK_URL"].removeprefix("udpout://").split(":")
    goal, system = json.loads(os.environ["WIL_GOAL"]), int(os.environ["WIL_SYSTEM_ID"])
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.settimeout(0.05)
    mav, parser = mavlink.MAVLink(None, srcSystem=200), mavlink.MAVLink(None)
    parser.robust_parsing = True
    moved = armed = 0
    print("flying to", goal["altitude_m"], flush=True)
    while True:
        link.sendto(mavlink.MAVLink_set_position_target_local_ned_message(
            0, system, 1, 1, 0b110111000111, 0, 0, 0, 0.5, 0, 0, 0, 0, 0, 0, 0
        ).pack(mav), (host, int(port)))
        until = time.monotonic() + 0.05
        while time.monotonic() < until:
            try:
                data = link.recv(2048)
            except TimeoutError:
                break
            for message in parser.parse_buffer(data) or []:
                if message.get_type() == "LOCAL_POSITION_NED" and message.get_srcSystem() != 200:
                    moved = message.x
        if moved > 1.0:
            print("there", flush=True)
            sys.exit(0)
"""


async def test_an_autonomy_that_is_a_program_flies(tmp_path: Path) -> None:
    script = tmp_path / "fly.py"
    script.write_text(textwrap.dedent(FLY))
    command = json.dumps([sys.executable, str(script)])
    given = (
        *sets(f"autonomy={{program: {command}}}", "vehicles.twin.start={north_m: 0}"),
        # A second camera, whose images are not for its one stream.
        *sets(
            "vehicles.twin.sensors.down={type: camera, rate_hz: 5, width_px: 80, height_px: 60, "
            "fov_deg: 69}"
        ),
        *sets(
            "oracles={time_limit: {limit_s: 60}, landed: {}, vehicle_fault: {}, "
            "reached: {required: false}}",
            "controls={}",
        ),
    )
    async with Program(tmp_path / "out", "--mode", "sim", "--json", *given) as program:
        landed = await program.end()
    assert landed.code == 0, landed.why
    (run,) = json.loads(landed.out)["runs"]
    assert (run["verdict"], run["reason"]) == ("PASS", "")
    (result,) = run["outside"]["programs"]
    assert result["exit"] == "ended by itself, exit code 0"
    assert result["refused"] > 0  # it flew before it was its turn
    assert result["video"]["failed"] == 0
    assert result["video"]["delivered"] > 20
    log = (program.run_folder("sim") / "twin-autonomy.log").read_text()
    assert log == "flying to 1.2\nthere\n"


CROPPED = """
    schema: wil/recipe/1
    sensors: {camera: {type: camera, rate_hz: 10}}
    combine:
      - sensor: camera
        transform: [register, {crop: {width_px: 120, height_px: 90, on: both}}]
        filter: [{isolate_color: {name: orange}}]
        merge: overlay
"""


async def test_a_program_is_sent_mixtures_of_the_size_that_the_recipe_gives_them(
    tmp_path: Path,
) -> None:
    script, recipe = tmp_path / "fly.py", tmp_path / "recipe.yaml"
    script.write_text(textwrap.dedent(FLY))
    recipe.write_text(textwrap.dedent(CROPPED))
    command = json.dumps([sys.executable, str(script)])
    given = (
        *(*SHORT, *sets(f"autonomy={{program: {command}}}", f"recipe={recipe}")),
        *sets(f"deliver=[{{rtp: '127.0.0.1:{free_port()}'}}]"),
    )
    async with Program(tmp_path / "out", "--mode", "wil", "--json", *given) as program:
        landed = await program.end()
    assert landed.code == 0, landed.why
    (run,) = json.loads(landed.out)["runs"]
    videos = {one["vehicle"]: one["video"] for one in run["outside"]["programs"]}
    assert set(videos) == {"real"}
    (outlet,) = run["outside"]["outlets"]
    sent = (videos["real"], outlet)
    assert all(one["failed"] == 0 and one["delivered"] > 20 for one in sent)
