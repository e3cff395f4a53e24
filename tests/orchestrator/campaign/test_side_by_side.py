"""Campaigns that are flown at once, in one folder, with one runtime folder and on one port."""

import asyncio
import json
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.faults.inspection import processes_of
from tests.orchestrator.hover import write_hover
from tests.ports import free_port

ROOT = Path(__file__).parents[3]
_END_WITHIN_S = 240.0


@dataclass(frozen=True, slots=True)
class Ended:
    """A program that has ended: its exit code, and what it wrote."""

    code: int
    out: str
    err: str


@pytest.fixture
def runtime() -> Iterator[Path]:
    """Beneath pytest's folders the path of a socket is too long."""
    folder = Path(tempfile.mkdtemp(prefix="wil-"))
    yield folder
    shutil.rmtree(folder)


async def flown(campaign: Path, runtime: Path, *arguments: str) -> Ended:
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "wil_campaign", "run", str(campaign), "--clock", "virtual"),
        *("--out", str(campaign.parent / "out"), "--repetitions", "1", "--json", *arguments),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        cwd=ROOT,
        env={**os.environ, "XDG_RUNTIME_DIR": str(runtime), "PYTHONPATH": str(ROOT)},
        start_new_session=True,
    )
    async with asyncio.timeout(_END_WITHIN_S):
        out, err = await process.communicate()
    return Ended(process.returncode or 0, out.decode(), err.decode())


def left_in(runtime: Path) -> list[str]:
    """Return the sockets and processes that a campaign left."""
    files = [str(path) for path in runtime.rglob("*") if not path.is_dir()]
    return files + [words for _, words in processes_of(runtime).values()]


async def test_programs_with_one_output_folder_have_own_folders_and_lose_nothing(
    tmp_path: Path, runtime: Path
) -> None:
    campaign = write_hover(tmp_path)
    ended = await asyncio.gather(*(flown(campaign, runtime) for _ in range(3)))
    assert [one.code for one in ended] == [0, 0, 0], ended
    folders = sorted((tmp_path / "out" / "hover").iterdir())
    assert len(folders) == 3
    for folder in folders:
        results = [json.loads(path.read_text("utf-8")) for path in folder.rglob("result.json")]
        assert [result["verdict"] for result in results] == ["PASS"]
        assert json.loads((folder / "summary.json").read_text("utf-8"))["totals"]["passed"] == 1
    assert left_in(runtime) == []


async def test_one_of_two_campaigns_with_one_broker_port_flies_and_the_other_says_why(
    tmp_path: Path, runtime: Path
) -> None:
    campaign, port = write_hover(tmp_path), free_port()
    broker = ("--broker", f"embedded:{port}")
    ended = await asyncio.gather(*(flown(campaign, runtime, *broker) for _ in range(2)))
    refused = [one for one in ended if one.code]
    assert len(refused) < 2, ended
    for one in refused:
        assert one.code == 3
        assert f"the embedded broker cannot use port {port}: " in one.err
    passed = [
        path
        for path in (tmp_path / "out").rglob("result.json")
        if json.loads(path.read_text("utf-8"))["verdict"] == "PASS"
    ]
    # One that ends before the other begins leaves it the port.
    assert len(passed) == 2 - len(refused)
    assert left_in(runtime) == []
