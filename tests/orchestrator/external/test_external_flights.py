"""Whole flights with something outside: a simulator, a stream."""

import asyncio
import json
import signal
import subprocess
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from tests.orchestrator.wall_runs import ROOT, SHORT, STAYING, Program
from tests.plugins.cameras.pumping import pump
from tests.ports import free_port
from wil_campaign.plugins.cameras.camera_factory import live_camera
from wil_campaign.vehicles.perception.blobs import BlobFinder
from wil_campaign.vehicles.perception.hsv import NAMED_COLORS
from wil_campaign.vehicles.readings import CameraReading
from wil_campaign.worlds.camera import Intrinsics

CAMERA = Intrinsics.from_fov(160, 120, 1.2)


@asynccontextmanager
async def simulator() -> AsyncIterator[tuple[str, "subprocess.Popen[str]"]]:
    """The reference simulator, in a process of its own; gives its address."""
    process = await asyncio.to_thread(
        subprocess.Popen,
        [
            *(sys.executable, "-m", "wil_campaign.plugins.simulator.reference_simulator"),
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
