"""Seeded kills in virtual time: who dies when, and what came of it.

`python -m tests.faults.virtual FIRST COUNT FOLDER` prints one JSON object for each kill.
"""

import asyncio
import csv
import json
import os
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from campaigns.expansion import Options, load_campaign
from orchestrator.operator import OperatorCommand
from orchestrator.recording.mcap_reader import read_recording
from orchestrator.results import RunResult
from orchestrator.run import run as running
from orchestrator.run.course import Course
from orchestrator.run.opening import Pair
from orchestrator.run.setup import RunOrder, RunSetup
from orchestrator.run.warming import warm_up
from tests.faults.mortal_loop import MortalLoop

ROOT = Path(__file__).parents[2]
CAMPAIGNS = {"gate": (14.0, 22.0, 27.0), "gate-ardupilot": (47.0, 55.0, 60.0)}
"""When the goal is given, done, and all is over in an undisturbed run, about, in seconds."""
VICTIMS = (
    *("real", "twin", "guard", "orchestrator", "stages", "judging", "trajectory", "operator"),
    *("autonomy", "source", "mixing", "any task"),
)
_NEEDED_UNTIL = {"source": "done", "mixing": "done", "autonomy": "done"}
"""Until which stage a victim is needed for a PASS; all others: until both have landed."""
_HARMLESS = frozenset(
    {
        *("nobody", "progress", "outside", "fences", "over"),
        *("guided after a hold", "perception without sensors"),
        # They wait for the tasks that expose, deliver and mix.
        *("real camera sensor", "perception"),
    }
)
"""Who has nothing to do in these flights, or neither judges nor records."""
_SMALL = tuple(
    f"vehicles.{name}.sensors.camera.{key}={value}"
    for name in ("real", "twin")
    for key, value in (("width_px", 160), ("height_px", 120))
)
_ENDS_WITHIN_S = 900.0
_DOWN_WITHIN_S = 120.0
_BEAT_S = 0.1
_GRAVEYARD: list[object] = []
"""Who died without clean-up must not be cleaned up by the collector either."""


@dataclass(frozen=True, slots=True)
class Fault:
    """A kill: in which campaign, of whom, when."""

    seed: int
    campaign: str
    victim: str
    at_s: float


@dataclass(frozen=True, slots=True)
class Aftermath:
    """What came of it. hit: who died in fact; stage: when; lost: what must not be."""

    fault: Fault
    hit: str
    stage: str
    verdict: str | None
    reason: str
    lost: tuple[str, ...]


def draw(seed: int) -> Fault:
    """Return the fault of a seed."""
    rng = np.random.default_rng([seed, 20])
    campaign = list(CAMPAIGNS)[seed // len(VICTIMS) % len(CAMPAIGNS)]
    victim = VICTIMS[seed % len(VICTIMS)]
    goal_s, done_s, over_s = CAMPAIGNS[campaign]
    begins_s, ends_s = (goal_s, done_s) if victim in _NEEDED_UNTIL else (0.5, over_s)
    return Fault(
        seed=seed,
        campaign=campaign,
        victim=victim,
        at_s=round(float(rng.uniform(begins_s, ends_s)), 3),
    )


class _Nobody:
    def poll(self) -> OperatorCommand | None:
        return None


class _Killing:
    """One run with one kill in it."""

    def __init__(self, fault: Fault, folder: Path) -> None:
        self.fault = fault
        self.folder = folder
        self.hit = "nobody"
        self.stage = "over"
        self.killed: set[asyncio.Task[Any]] = set()
        self.pair: Pair | None = None
        self.course: Course | None = None
        self.run: asyncio.Task[RunResult]
        self._alive = True

    def disturb(self, pair: Pair, course: Course) -> None:
        self.pair, self.course = pair, course
        loop = asyncio.get_running_loop()
        loop.call_at(max(self.fault.at_s, loop.time()), self._strike)
        self._beat()

    def _beat(self) -> None:
        """Give the signs of life that an orchestrator's process gives its guard."""
        if self._alive and self.pair is not None:
            self.pair.guard.alive()
            asyncio.get_running_loop().call_later(_BEAT_S, self._beat)

    def _strike(self) -> None:
        assert self.pair is not None
        assert self.course is not None
        if self.run.done():
            return
        self.stage = self.course.stage
        victim, loop = self.fault.victim, asyncio.get_running_loop()
        assert isinstance(loop, MortalLoop)
        self.hit = victim
        if victim in self.pair.vehicles:
            self.pair.vehicles[victim].kill()  # type: ignore[attr-defined]  # embedded ones can
        elif victim == "guard":
            self.pair.guard._apply = lambda *_: None  # type: ignore[union-attr, method-assign]
        elif victim == "orchestrator":
            self._kill_orchestrator(loop)
        else:
            found = self._tasks()
            self.hit = ", ".join(sorted(task.get_name() for task in found)) or "nobody"
            self.killed = found
            loop.kill(found)

    def _tasks(self) -> set[asyncio.Task[Any]]:
        ours = {self.run, self.main}
        tasks = sorted(asyncio.all_tasks() - ours, key=lambda task: task.get_name())
        tasks = [task for task in tasks if task.get_name() != "watchdog"]
        match self.fault.victim:
            case "stages":
                wanted = [task for task in tasks if task.get_name() == "flight"]
            case "autonomy":
                wanted = [task for task in tasks if task.get_name().endswith(" pilot")]
            case "source":
                wanted = [task for task in tasks if " camera " in task.get_name()]
            case "mixing":
                wanted = [task for task in tasks if task.get_name().startswith("mixing ")]
            case "any task":
                rng = np.random.default_rng([self.fault.seed, 21])
                wanted = [tasks[int(rng.integers(len(tasks)))]]
            case name:
                wanted = [task for task in tasks if task.get_name() == name]
        return set(wanted)

    def _kill_orchestrator(self, loop: MortalLoop) -> None:
        assert self.pair is not None
        self._alive = False
        guard: Any = self.pair.guard
        guard._listeners.clear()
        guard._record = None
        for ends in guard._links.values():
            ends.orchestrator._other = None
        for vehicle in self.pair.vehicles.values():
            vehicle._truth_callbacks.clear()  # type: ignore[attr-defined]
            vehicle._mocap._callbacks.clear()  # type: ignore[attr-defined]
        loop.kill_all_but({self.main})

    async def fly(self) -> RunResult | None:
        """Return the result; None when nobody was left to give one."""
        setup = setup_of(self.fault.campaign, self.folder)
        warm_up(setup)
        task = asyncio.current_task()
        assert task is not None
        self.main = task
        flown = running._fly(setup, lambda _: None, _Nobody(), self.disturb)
        self.run = asyncio.create_task(flown, name="run")
        loop = asyncio.get_running_loop()
        while not self.run.done() and loop.time() < _ENDS_WITHIN_S:
            if self.hit == "orchestrator" and self._over(loop.time()):
                return None
            await asyncio.sleep(0.5)
        return self.run.result() if self.run.done() else None

    def _over(self, now_s: float) -> bool:
        late = now_s > self.fault.at_s + _DOWN_WITHIN_S
        return late or all(self.is_down(name) for name in self.vehicles())

    def vehicles(self) -> list[str]:
        return [] if self.pair is None else list(self.pair.vehicles)

    def is_down(self, name: str) -> bool:
        """Return whether a vehicle is in truth on the ground, and disarmed."""
        assert self.pair is not None
        vehicle: Any = self.pair.vehicles[name]
        down_m = vehicle.truth().pose.position_ned_m[2]
        return not vehicle.autopilot.flight.armed and abs(down_m) < 0.2


def setup_of(campaign: str, folder: Path) -> RunSetup:
    options = Options(cases=("large",), modes=("wil",), sets=_SMALL)
    plan = load_campaign(ROOT / "campaigns" / f"{campaign}.yaml", options).runs[0]
    return RunSetup.of(RunOrder(plan=plan, folder=folder, clock="virtual"))


def inject(fault: Fault, folder: Path) -> Aftermath:
    """Fly a run with a fault in it, and return what came of it."""
    folder.mkdir(parents=True)
    killing = _Killing(fault, folder)
    loop = MortalLoop()
    result = loop.run_until_complete(killing.fly())
    mended = bool(killing.killed) and killing.killed <= loop.went_on
    lost = [*_found(killing, result, mended=mended), *unreadable(folder)]
    for task in asyncio.all_tasks(loop):
        task._log_destroy_pending = False  # type: ignore[attr-defined]
    _GRAVEYARD.append((loop, asyncio.all_tasks(loop), killing))
    return Aftermath(
        fault,
        killing.hit,
        killing.stage,
        None if result is None else result.verdict,
        "" if result is None else result.reason,
        tuple(lost),
    )


def _found(killing: _Killing, result: RunResult | None, *, mended: bool) -> list[str]:
    """Return what must not be after a kill. mended: a time-out of its own woke who was dead."""
    found = []
    if result is None and killing.hit != "orchestrator":
        found.append(f"the run had not ended after {_ENDS_WITHIN_S:g} s")
    names = [name for name in killing.vehicles() if killing.hit != name]
    found += [f"{name} is not down" for name in names if not killing.is_down(name)]
    passed = result is not None and result.verdict == "PASS"
    if passed and not mended and _was_needed(killing):
        found.append(f"PASS, though {killing.hit} died in stage {killing.stage}")
    if result is not None and result.verdict != "PASS" and not result.reason:
        found.append(f"{result.verdict} without a reason")
    return found


def _was_needed(killing: _Killing) -> bool:
    if killing.hit in _HARMLESS:
        return False
    assert killing.course is not None
    until = _NEEDED_UNTIL.get(killing.fault.victim, "landed")
    reached_s = killing.course.entered_s.get(until)  # type: ignore[call-overload]
    # What the last moments lacked was within the recipe's budget, or the autopilot's patience.
    spare_s = 1.2 if until == "done" else 0.0
    return reached_s is None or killing.fault.at_s < reached_s - spare_s


def unreadable(folder: Path) -> list[str]:
    """Return which files of a run cannot be read, and why."""
    readers: dict[str, Callable[[Path], object]] = {
        "trajectory.csv": lambda path: list(csv.DictReader(path.read_text("utf-8").splitlines())),
        "log.jsonl": _read_lines,
        "run.mcap": lambda path: sum(1 for _ in read_recording(path)),
        "result.json": lambda path: json.loads(path.read_text("utf-8")),
    }
    found = []
    for name, read in readers.items():
        path = folder / name
        if not path.exists():
            continue
        try:
            read(path)
        except Exception as error:  # noqa: BLE001 - whatever it is, it is what we look for
            found.append(f"{name}: {type(error).__name__}: {error}")
    return found


def _read_lines(path: Path) -> None:
    whole = path.read_text("utf-8").rpartition("\n")[0]
    for line in whole.splitlines():
        json.loads(line)


def main(arguments: list[str]) -> None:
    first, count = int(arguments[0]), int(arguments[1])
    folder = Path(arguments[2])
    for seed in range(first, first + count):
        aftermath = inject(draw(seed), folder / str(seed))
        sys.stdout.write(json.dumps(asdict(aftermath)) + "\n")
        sys.stdout.flush()
    os._exit(0)  # The dead are not to be tidied up.


if __name__ == "__main__":
    main(sys.argv[1:])
