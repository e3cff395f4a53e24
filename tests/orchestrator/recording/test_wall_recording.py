"""run.mcap of a flight under the wall clock whose program is killed: what was flown is there."""

import asyncio
import contextlib
import os
import signal
import time
from collections import Counter
from pathlib import Path

from tests.orchestrator.wall_runs import STAYING, Program
from wil_campaign.plugins.python.mcap_reader import (
    RecordedProvenance,
    RecordedReading,
    Recording,
)

RECORDED = {"real camera", "twin camera", "mixed camera", "provenance"}


def writer_of(path: Path) -> int:
    """Return the process that has a file open: the one that flies the run."""
    for opened in Path("/proc").glob("[0-9]*/fd/*"):
        with contextlib.suppress(OSError):
            if opened.samefile(path):
                return int(opened.parts[2])
    raise LookupError(f"nobody has {path} open")


def contents(recording: Recording) -> tuple[Counter[str], float]:
    """Return how much of each kind is in a recording, and when its last mixture was recorded."""
    found: Counter[str] = Counter()
    last_s = 0.0
    for item in recording:
        if isinstance(item, RecordedReading):
            found[f"{item.reading.source} {item.sensor}"] += 1
        elif isinstance(item, RecordedProvenance):
            found["provenance"] += 1
            last_s = item.log_ns / 1e9
    return found, last_s


def has_enough(recorded: tuple[Counter[str], float]) -> bool:
    return all(recorded[0][kind] > 30 for kind in RECORDED)


async def test_a_recording_outlives_kill_9_of_its_program(tmp_path: Path) -> None:
    async with Program(tmp_path / "out", "--mode", "wil", *STAYING) as program:
        await program.stage("goal")
        path = program.run_folder() / "run.mcap"
        async with asyncio.timeout(60.0):
            while not has_enough(await asyncio.to_thread(contents, Recording(path))):  # noqa: ASYNC110
                await asyncio.sleep(0.5)
        writer = writer_of(path)
        os.kill(writer, signal.SIGKILL)
        killed_s = time.time()
        landed = await program.end()
    assert landed.code == 3, landed.why
    recording = Recording(path)
    found, last_s = contents(recording)
    assert recording.end is not None
    assert not recording.end.whole
    assert set(found) == RECORDED
    assert has_enough((found, last_s))
    # A chunk spans half a second; a loaded machine is given more.
    assert killed_s - 10.0 < last_s < killed_s
