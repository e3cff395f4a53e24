"""Seeded faults in virtual time: what happens when, and what came of it.

`python -m tests.faults.virtual FIRST COUNT FOLDER` prints one JSON object for each kill or stop;
`python -m tests.faults.virtual FIRST COUNT FOLDER troubles` for each other trouble.
"""

import asyncio
import json
import os
import sys
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tests.faults.barriers import UNDISTURBED, acted_after_s, late
from tests.faults.draws import WHILE_FLOWN, Fault, draw_kill, draw_trouble
from tests.faults.mortal_loop import MortalLoop
from tests.faults.readable import unreadable
from tests.faults.strikes import KEY, Strike, signing_vehicles
from tests.faults.witness import Witness
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.orchestrator.run.flight import run as running
from wil_campaign.orchestrator.run.perception.warm_up import warm_up
from wil_campaign.orchestrator.run.vehicles.pair import VehiclePair
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup
from wil_campaign.orchestrator.state.run_state import RunState, Stage
from wil_campaign.safety.guard.core.commands import OrchestratorAlive
from wil_campaign.safety.guard.core.contingency import ContingencyPhase
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.vehicles.links.link_conditions import KeySource

ROOT = Path(__file__).parents[2]
_HARMLESS = frozenset(
    {
        *("nobody", "progress", "external I/O", "fences", "over"),
        *("guided after a hold", "perception without sensors"),
        # They wait for the tasks that expose, deliver and mix.
        *("real camera sensor", "perception"),
        # The real flight is flown, and judged, without it.
        *("twin", "twin autonomy"),
    }
)
"""Who has nothing to do in these flights, or neither judges nor records."""
_MUST_NOT_PASS = frozenset({"disk full", "folder read-only"})
"""Troubles before the landing after which nothing is a PASS: its record is not whole."""
_LONGEST_GAP_S = 1.0
"""Of the link, by both campaigns; a heartbeat is a second, so that a gap may be half of one more.
A link that is dark for longer while the pair is armed must not PASS."""
_GAP_SPARE_S = 0.5
_SMALL = tuple(
    f"vehicles.{name}.sensors.camera.{key}={value}"
    for name in ("real", "twin")
    for key, value in (("width_px", 160), ("height_px", 120))
)
_ACTS_WITHIN_S = {"orchestrator": 0.5, "real": 3.2}
"""After whose end in the air the guard has to take over, and how soon."""
_ENDS_WITHIN_S = 900.0
_DOWN_WITHIN_S = 120.0
_SEEN_S = 3.0
"""After a landing the guard is given as long to see it, and to say so."""
_BEAT_S = 0.1
_GRAVEYARD: list[object] = []
"""Who died without clean-up must not be cleaned up by the collector either."""


@dataclass(frozen=True, slots=True)
class Aftermath:
    """What came of it. hit: who was hit in fact; stage: when; lost: what must not be.

    acted_s: how long after that the guard took over.
    """

    fault: Fault
    hit: str
    stage: str
    verdict: str | None
    reason: str
    acted_s: float | None
    lost: tuple[str, ...]


class _Nobody:
    def poll(self) -> OperatorCommand | None:
        return None


class _Flight:
    """One run with one fault in it."""

    def __init__(self, fault: Fault, folder: Path) -> None:
        self.fault = fault
        self.folder = folder
        self.stage = "over"
        self.pair: VehiclePair | None = None
        self.run_state: RunState | None = None
        self.strike: Strike | None = None
        self.witness = Witness({})
        self.struck_s: float | None = None
        self.armed_then: tuple[str, ...] = ()
        self.run: asyncio.Task[None]

    @property
    def hit(self) -> str:
        return "nobody" if self.strike is None else self.strike.hit

    def disturb(self, pair: VehiclePair, run_state: RunState) -> None:
        self.pair, self.run_state = pair, run_state
        self.strike = Strike(self.fault, pair, self.folder)
        self.witness = Witness(pair.vehicles)
        self.witness.watch()
        loop = asyncio.get_running_loop()
        loop.call_at(max(self.fault.at_s, loop.time()), self._strike)
        self._beat()

    def _beat(self) -> None:
        """Give the signs of life that an orchestrator's process gives its guard."""
        now_s = asyncio.get_running_loop().time()
        silent = self.hit == "orchestrator" and now_s < self.fault.at_s + self.fault.for_s
        if self.pair is not None and not silent:
            self.pair.guard.send(OrchestratorAlive())
        asyncio.get_running_loop().call_later(_BEAT_S, self._beat)

    def _strike(self) -> None:
        assert self.pair is not None
        assert self.run_state is not None
        assert self.strike is not None
        if self.run.done():
            return
        self.stage = self.run_state.stage
        loop = asyncio.get_running_loop()
        assert isinstance(loop, MortalLoop)
        self.struck_s = loop.time()
        self.witness.look()
        sights = self.witness.sights.items()
        self.armed_then = tuple(name for name, sight in sights if sight.armed)
        victim = self.fault.victim
        if self.fault.kind == "trouble":
            self.strike.trouble()
        elif victim in self.pair.vehicles:
            self.strike.vehicle(victim)
        elif victim == "guard":
            self.strike.guard()
        elif victim == "orchestrator":
            self.strike.orchestrator(loop, {self.main})
        else:
            self.strike.tasks(loop, self._tasks())

    def _tasks(self) -> set[asyncio.Task[Any]]:
        ours = {self.run, self.main}
        tasks = sorted(asyncio.all_tasks() - ours, key=lambda task: task.get_name())
        tasks = [task for task in tasks if task.get_name() != "watchdog"]
        match self.fault.victim:
            case "stages":
                wanted = [task for task in tasks if task.get_name() == "flight"]
            case "autonomy":
                wanted = [task for task in tasks if task.get_name().endswith(" autonomy")]
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

    async def fly(self, setup: RunSetup) -> RunResult | None:
        """Return the result; None when nobody was left to give one."""
        warm_up(setup)
        task = asyncio.current_task()
        assert task is not None
        self.main = task
        flown = running.FlownRun(setup)
        begun = flown.fly(lambda _: None, _Nobody(), self.disturb)
        self.run = asyncio.create_task(begun, name="run")
        loop = asyncio.get_running_loop()
        killed = self.fault.kind == "kill"
        while not self.run.done() and loop.time() < _ENDS_WITHIN_S:
            if killed and self.hit == "orchestrator" and self._over(loop.time()):
                break
            await asyncio.sleep(0.5)
        self.witness.look()
        if not self.run.done():
            return None
        self.run.result()
        return flown.result()

    def _over(self, now_s: float) -> bool:
        late = now_s > self.fault.at_s + _DOWN_WITHIN_S
        sights = self.witness.sights.values()
        return late or all(sight.down and now_s - sight.down_s > _SEEN_S for sight in sights)


def setup_of(fault: Fault, folder: Path) -> RunSetup:
    options = ExpansionOptions(cases=("large",), modes=("wil",), sets=_SMALL)
    plan = load_campaign(ROOT / "campaigns" / f"{fault.campaign}.yaml", options).runs[0]
    setup = RunSetup.of(RunOrder(plan=plan, folder=folder, clock="virtual"))
    if fault.victim != "forged":
        return setup
    source = KeySource("environment", KEY)
    return replace(
        setup, vehicles=tuple(replace(vehicle, signing=source) for vehicle in setup.vehicles)
    )


def _undo(flight: _Flight) -> None:
    if flight.strike is not None:
        flight.strike.undo()


def inject(fault: Fault, folder: Path) -> Aftermath:
    """Fly a run with a fault in it, and return what came of it."""
    folder.mkdir(parents=True)
    flight, loop = _Flight(fault, folder), MortalLoop()
    with ExitStack() as stack:
        if fault.victim == "forged":
            stack.enter_context(signing_vehicles())
        stack.callback(_undo, flight)
        result = loop.run_until_complete(flight.fly(setup_of(fault, folder)))
    lost = [*_findings_of(flight, result, loop), *unreadable(folder), *_unsaid(flight, result)]
    for task in asyncio.all_tasks(loop):
        task._log_destroy_pending = False  # type: ignore[attr-defined]
    _GRAVEYARD.append((loop, asyncio.all_tasks(loop), flight))
    return Aftermath(
        fault,
        flight.hit,
        flight.stage,
        None if result is None else result.verdict,
        "" if result is None else result.reason,
        _acted_s(flight),
        tuple(lost),
    )


def _findings_of(flight: _Flight, result: RunResult | None, loop: MortalLoop) -> list[str]:
    """Return what must not be after a fault."""
    found, fault = [], flight.fault
    dead = fault.victim if fault.kind == "kill" else ""
    if result is None and dead != "orchestrator":
        found.append(f"the run had not ended after {_ENDS_WITHIN_S:g} s")
    for name, sight in flight.witness.sights.items():
        if name != dead and not sight.down:
            found.append(f"{name} is not down: armed {sight.armed}, {sight.up_m:.2f} m up")
        if name != dead and sight.fell:
            found.append(f"{name} fell: {sight.sink_m_s:.1f} m/s")
    found += _unguarded(flight)
    if result is not None and result.verdict != "PASS" and fault.victim in UNDISTURBED:
        found.append("it should not have disturbed the flight")
    if result is not None and result.verdict == "PASS":
        found += [f"PASS, though {what}" for what in flight.witness.not_completed(but=_gone(fault))]
        if _was_needed(flight, loop):
            found.append(f"PASS, though {flight.hit} was hit in stage {flight.stage}")
    return found


def _gone(fault: Fault) -> str:
    """Return the vehicle of which a PASS says nothing, for it is what was hit."""
    return "twin" if "twin" in fault.victim or fault.victim == "any task" else ""


def _acted_s(flight: _Flight) -> float | None:
    events = [] if flight.pair is None else flight.pair.guard.events
    return acted_after_s([(event.t_s, event.kind) for event in events], flight.struck_s)


def _unguarded(flight: _Flight) -> list[str]:
    """Return what the guard was late with; who was stopped for less is not waited for."""
    within_s = _ACTS_WITHIN_S.get(flight.hit)
    if within_s is not None and flight.fault.for_s <= within_s:
        return []
    if flight.hit in flight.witness.sights and flight.hit not in flight.armed_then:
        return []
    sights = flight.witness.sights.items()
    others = {n: one for n, one in sights if n != flight.hit and n in flight.armed_then}
    acted_s = _acted_s(flight)
    found = late(acted_s, within_s, flight.struck_s, others)
    if within_s is None or acted_s is None or flight.pair is None:
        return found
    phases = flight.pair.guard.phases
    return found + [
        f"the guard did not bring {name} down: {phases[name].value}"
        for name in others
        if phases[name] is not ContingencyPhase.DOWN
    ]


def _unsaid(flight: _Flight, result: RunResult | None) -> list[str]:
    """Return what has no reason though people will ask for one."""
    if result is not None:
        return [] if result.verdict == "PASS" or result.reason else [f"{result.verdict}, no reason"]
    flew = any(sight.flew for sight in flight.witness.sights.values())
    said = flight.pair is None or flight.pair.guard.events or not flew
    return [] if said else ["nobody says what happened"]


def _was_needed(flight: _Flight, loop: MortalLoop) -> bool:
    """Return whether there must be no PASS after what was hit."""
    fault, strike, run_state = flight.fault, flight.strike, flight.run_state
    if strike is None or run_state is None or strike.hit in _HARMLESS or flight.struck_s is None:
        return False
    until: Stage = "done" if fault.victim in WHILE_FLOWN else "landed"
    # What the last moments lacked was within the recipe's budget, or the autopilot's patience.
    spare_s = 1.2 if until == "done" else 0.0
    before_s = run_state.entered_s.get(until, float("inf")) - spare_s
    if fault.kind == "trouble":
        dark = fault.victim.startswith("dark")
        if not dark:
            return fault.victim in _MUST_NOT_PASS and fault.at_s < before_s
        if fault.victim == "dark twin":
            # The required oracles judge the real vehicle; the twin's gaps are reported.
            return False
        armed_s = run_state.entered_s.get("takeoff", float("inf"))
        begins_s, ends_s = max(armed_s, fault.at_s), min(fault.at_s + fault.for_s, before_s)
        return ends_s - begins_s > _LONGEST_GAP_S + _GAP_SPARE_S
    if fault.kind == "stop":
        # Who was stopped for a while went on; what it did not see its watchers know.
        return False
    mended = bool(strike.killed) and all(
        loop.woken_s.get(task, before_s) < before_s for task in strike.killed
    )
    return fault.at_s < before_s and not mended


def main(arguments: list[str]) -> None:
    first, count = int(arguments[0]), int(arguments[1])
    folder = Path(arguments[2])
    draw = draw_trouble if arguments[3:] == ["troubles"] else draw_kill
    for seed in range(first, first + count):
        aftermath = inject(draw(seed), folder / str(seed))
        sys.stdout.write(json.dumps(asdict(aftermath)) + "\n")
        sys.stdout.flush()
    os._exit(0)  # The dead are not to be tidied up.


if __name__ == "__main__":
    main(sys.argv[1:])
