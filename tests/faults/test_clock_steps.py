"""The wall clock steps by an hour, on and back, under a flight, and nobody takes notice.

By libfaketime: the C library itself gives the stepped time, to all processes of the flight.
"""

import asyncio
import json
import sys
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from tests.faults.inspection import all_gone, truth_receiver
from tests.faults.processes import FaultyProgram
from tests.faults.socket_ledger import files_left, socket_ledger
from tests.orchestrator.wall_runs import END_WITHIN_S, SHORT, stages

_HOUR_S = 3600.0
NAME = "faketime/libfaketimeMT.so.1"
LIBRARIES = sorted({*Path("/usr/lib").glob(NAME), *Path("/usr/lib").glob(f"*/{NAME}")})


class SteppedProgram(FaultyProgram):
    """The program under a C library whose wall clock is off by what stands in a file."""

    @property
    def environment(self) -> dict[str, str]:
        return {
            **super().environment,
            "LD_PRELOAD": str(LIBRARIES[0]),
            "FAKETIME_TIMESTAMP_FILE": str(self.step.with_name("faketime")),
            "FAKETIME_CACHE_DURATION": "1",
            "FAKETIME_DONT_FAKE_MONOTONIC": "1",
            # Else a thread that waits for Python's lock waits 0.4 s for it, not 5 ms.
            "FAKETIME_FORCE_MONOTONIC_FIX": "0",
        }

    def step_to(self, offset: str) -> None:
        """Step the clock of all processes of the flight; offset: from the true time ("-1h")."""
        place = self.step.with_name("faketime")
        part = place.with_name("faketime.part")
        part.write_text(offset + "\n")
        part.replace(place)


@asynccontextmanager
async def clock_of(program: SteppedProgram) -> AsyncIterator[Callable[[], Awaitable[float]]]:
    """Give what tells by how many seconds a process that began as the flight's is off by now."""
    words = "import sys, time\nfor _ in sys.stdin: print(time.time(), flush=True)"
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-c", words),
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        env={**program.environment, "XDG_RUNTIME_DIR": "/nowhere"},
    )
    reads, asks = process.stdout, process.stdin
    assert reads is not None
    assert asks is not None

    async def off_s() -> float:
        asks.write(b"\n")
        return float(await reads.readline()) - time.time()

    try:
        yield off_s
    finally:
        process.kill()
        await process.wait()


@pytest.mark.skipif(not LIBRARIES, reason="libfaketime is not installed")
@pytest.mark.parametrize(
    ("mode", "clock"),
    [
        pytest.param("sim", "scaled", marks=pytest.mark.no_turn("lockstep"), id="sim"),
        pytest.param("wil", "wall", id="wil"),
    ],
)
async def test_a_clock_that_steps_on_and_back_disturbs_no_flight(
    tmp_path: Path, mode: str, clock: str
) -> None:
    pace = ("--set", "clock.speed=1") if clock == "scaled" else ()
    arguments = ("--mode", mode, "--json", *SHORT, *pace)
    async with truth_receiver() as (truth, port):
        step = tmp_path / "clock-step"
        program = SteppedProgram(
            tmp_path / "out", *arguments, step=step, truth_port=port, clock=clock
        )
        program.step_to("+0")
        async with program, clock_of(program) as seen, socket_ledger(program.runtime) as ledger:
            off_s = [await seen()]
            await program.stage("takeoff", mode, END_WITHIN_S)
            program.step_to("+1h")
            await program.stage("at_height", mode, END_WITHIN_S)
            off_s.append(await seen())
            program.step_to("-1h")
            landed = await program.end()
            off_s.append(await seen())
            left = await all_gone(program.runtime, 60.0)
            also_left = [*ledger.left(), *files_left(program.runtime)]
        folder = program.run_folder(mode)
    assert [round(one / _HOUR_S, 1) for one in off_s] == [0.0, 1.0, -1.0]
    assert (landed.code, landed.err) == (0, ""), landed.why
    assert (left, also_left) == ({}, [])
    assert ledger.seen
    flown = {"twin"} if mode == "sim" else {"real", "twin"}
    assert {name: sight.down for name, sight in truth.sights.items()} == dict.fromkeys(flown, True)
    assert all(sight.flew and not sight.fell for sight in truth.sights.values())
    result = json.loads((folder / "result.json").read_text("utf-8"))
    assert (result["verdict"], result["losses"]) == ("PASS", [])
    assert 5.0 < result["duration_s"] < result["wall_s"] < 1000.0
    assert stages(folder)[-2:] == ["landed", "end"]
