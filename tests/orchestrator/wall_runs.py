"""What tests with real processes share: a campaign flown under the wall clock, and what is left."""

import asyncio
import json
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from tests.orchestrator.conftest import STEP

ROOT = Path(__file__).parents[2]
PATIENT = (
    *(
        f"vehicles.{name}.sensors.camera.{key}={value}"
        for name in ("real", "twin")
        for key, value in (("width_px", 160), ("height_px", 120))
    ),
    *(f"sync.max_{what}_skew_s=10" for what in ("command", "takeoff", "t0")),
    "oracles.link.max_gap_s=20",
    "recipe.combine.0.max_skew_ms=800",
    *(f"vehicles.{name}.telemetry.max_gap_s=5" for name in ("real", "twin")),
)
"""Small pictures, and limits that a loaded machine does not exceed: what is tested is who lives."""
SHORT = tuple(word for one in (*STEP, "controls={}") for word in ("--set", one))
"""Up, a step ahead, and down, far from the gate: close by, pictures that a loaded machine mixes a
tenth of a second late show it far from its place, which rightly makes the run INVALID."""
STAYING = (
    *(*SHORT, "--set", "autonomy.with={speed_m_s: 0.05, for_s: 60}"),
    *("--set", "oracles.time_limit.limit_s=120"),
)
"""The same, at its goal for a minute: what happens there finds it there, however late."""
END_WITHIN_S = 240.0
"""A hang is found by it, a slow machine is not: tests/conftest.py gives the whole test more."""


@dataclass(frozen=True)
class Landed:
    """What a program that flew left behind."""

    code: int
    out: str
    err: str

    @property
    def why(self) -> str:
        """What an assertion shows when it ended otherwise: each run's reasons, and its errors."""
        try:
            runs = json.loads(self.out)["runs"]
        except (ValueError, KeyError):
            return f"exit code {self.code}\n{self.out[-4000:]}\n{self.err[-4000:]}"
        said = [f"exit code {self.code}"]
        for run in runs:
            name = f"{run['case']}/{run['mode']}"
            all_of_it = (run, *run["also"])
            said += [f"{name}: {one['verdict']}: {one['reason']}" for one in all_of_it]
            said.append(f"mixing: {run['mixing']}")
        return "\n".join((*said, self.err[-4000:]))


class Program:
    """`wil-campaign run` as a process of its own, on the wall clock; an async context manager."""

    def __init__(
        self,
        out: Path,
        *arguments: str,
        runtime: Path | None = None,
        clock: str | None = "wall",
        flown: tuple[str, str] = ("gate", "large"),
        has_cameras: bool = True,
    ) -> None:
        self.out = out
        self._campaign, self._case = flown
        self._clock = () if clock is None else ("--clock", clock)
        # Beneath pytest's folders the path of a socket is too long.
        self.runtime = runtime or Path(tempfile.mkdtemp(prefix="wil-"))
        self._arguments = arguments
        self._patient = [one for one in PATIENT if has_cameras or ".camera." not in one]

    async def __aenter__(self) -> Self:
        sets = [word for one in self._patient for word in ("--set", one)]
        self.process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "wil_campaign", "run", f"campaigns/{self._campaign}.yaml"),
            *(*self._clock, "--case", self._case, "--repetitions", "1", "--jobs", "1"),
            *("--out", str(self.out), *sets, *self._arguments),
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            cwd=ROOT,
            env=self.environment,
            start_new_session=True,
        )
        return self

    async def __aexit__(self, *error: object) -> None:
        if self.process.returncode is None:
            self.process.kill()
        await self.process.communicate()
        shutil.rmtree(self.runtime)

    @property
    def environment(self) -> dict[str, str]:
        return {**os.environ, "XDG_RUNTIME_DIR": str(self.runtime), "PYTHONPATH": str(ROOT)}

    async def end(self, timeout_s: float = END_WITHIN_S) -> Landed:
        async with asyncio.timeout(timeout_s):
            out, err = await self.process.communicate()
        return Landed(self.process.returncode or 0, out.decode(), err.decode())

    async def operate(self, *arguments: str) -> Landed:
        """Run another command of ours beside it."""
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "wil_campaign", *arguments),
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            cwd=ROOT,
            env=self.environment,
        )
        out, err = await process.communicate()
        return Landed(process.returncode or 0, out.decode(), err.decode())

    @property
    def folder(self) -> Path:
        """The folder of the campaign, once there is one."""
        return next(iter((self.out / self._campaign).iterdir()))

    def run_folder(self, mode: str = "wil") -> Path:
        return self.folder / self._case / mode / "1"

    async def stage(self, stage: str, mode: str = "wil", timeout_s: float = 120.0) -> None:
        """Wait until the run has reached a stage; a program that ended before says why."""

        def there() -> bool:
            try:
                return stage in stages(self.run_folder(mode))
            except (OSError, StopIteration):
                return False

        await until(lambda: there() or self.process.returncode is not None, timeout_s)
        if not there():
            landed = await self.end()
            raise AssertionError(f"it ended before the stage '{stage}': {landed.why}")

    async def await_event(self, kind: str, mode: str = "wil", timeout_s: float = 60.0) -> None:
        """Wait until the guard of a run has told an event of this kind."""
        path = self.run_folder(mode) / "guard.jsonl"
        await until(lambda: kind in [line.get("kind") for line in lines(path)], timeout_s)


def lines(path: Path) -> list[dict[str, Any]]:
    """Return the objects of a file of JSON lines, the last one perhaps not yet whole."""
    whole = path.read_text("utf-8").rpartition("\n")[0]
    return [json.loads(line) for line in whole.splitlines()]


def stages(folder: Path) -> list[str]:
    return [line["stage"] for line in lines(folder / "log.jsonl") if line["event"] == "stage"]


async def until(condition: Callable[[], bool], timeout_s: float = 60.0) -> None:
    """Wait until a condition of other processes holds."""
    async with asyncio.timeout(timeout_s):
        while not condition():  # noqa: ASYNC110 - other processes set no event of ours
            await asyncio.sleep(0.02)
