"""An attempt in which the subject failed anything is not flown again, however it ended."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.orchestrator.hover import write_hover
from wil_campaign.campaigns.expansion.expansion import RunPlan, load_campaign
from wil_campaign.orchestrator.campaign.resuming.runs_without_result import lost_result
from wil_campaign.orchestrator.campaign.workers.run_workers import WorkerLost
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.run.vehicles.pair import VehiclePair
from wil_campaign.orchestrator.run_results.attempts import retry_due
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_state import RunState

Fly = Callable[..., tuple[RunResult, Path]]
LOST = "its process ended with exit status 3 before it had a verdict"
CLIMB = '{"t_s": 9.0, "event": "stage", "stage": "takeoff"}\n'
GOAL = '{"t_s": 20.0, "event": "stage", "stage": "goal"}\n'
TOUCHED = (
    '{"t_s": 21.0, "event": "decisive", "kind": "FAIL", "reason": "twin touched wall", '
    '"source": "collision/twin"}\n'
)
INVALID = (
    '{"t_s": 20.5, "event": "decisive", "kind": "INVALID", "reason": "stopped", '
    '"source": "evidence/pose/twin"}\n'
)
ABORTED = (
    '{"t_s": 20.5, "event": "decisive", "kind": "ABORTED", "reason": "its parent process died", '
    '"source": "guard.abort/"}\n'
)
FAULT = (
    '{"t_s": 20.5, "event": "decisive", "kind": "ERROR", "reason": "flight: KeyError: 1", '
    '"source": "exception"}\n'
)
ONCE = """\
import os
import signal
import threading
import time
from pathlib import Path

from wil_campaign.vehicles.autonomy import Command
from wil_campaign.vehicles.setpoints import VelocitySetpoint


class Still:
    '''Does WHAT in its first flight, and hovers in each other.'''

    def __init__(self, *, goal, parameters, seed):
        self.left, self.kept = 40, []

    def perceive(self, reading):
        pass

    def act(self, telemetry):
        self.left -= 1
        flown = Path(__file__).with_name("flown")
        if self.left == 20 and not flown.exists():
            flown.touch()
            WHAT
        return Command(VelocitySetpoint((0.0, 0.0, 0.0)), done=self.left <= 0)
"""


@pytest.mark.usefixtures("forked_workers")
@pytest.mark.parametrize(
    ("what", "said"),
    [
        ("os._exit(3)", "the autonomy of twin did not return from a call: its process ended with"),
        ("os.kill(os.getpid(), signal.SIGSEGV)", "did not return from a call: its process was"),
        ("self.kept.append(b'x' * 400_000_000)", "twin uses too much memory: the run's"),
        ("self.kept.append(b'x' * 4_000_000_000)", "the autonomy of twin was refused memory: "),
        ("time.sleep(3)", "the autonomy of twin gave no answer within 0.5 s"),
    ],
)
def test_death_memory_and_time_after_the_goal_are_failures_of_the_autonomy(
    tmp_path: Path, what: str, said: str
) -> None:
    """Every second flight of each of these passes."""
    path = write_hover(tmp_path)
    (tmp_path / "still.py").write_text(ONCE.replace("WHAT", what))
    call_s = 0.5 if "sleep" in what else 30
    limited = f"{{use: still.py:Still, limits: {{memory_mb: 300, call_s: {call_s}}}}}"
    text = path.read_text().replace("repetitions: 2", "repetitions: 1\nretries: 1")
    path.write_text(text.replace("autonomy: still.py:Still", f"autonomy: {limited}"))
    assert main(["run", str(path), "--out", str(tmp_path / "out")]) == 1
    (summary,) = (tmp_path / "out" / "hover").glob("*/summary.json")
    (run,) = json.loads(summary.read_text("utf-8"))["runs"]
    assert (run["verdict"], run["attempts"], run["decided_by"]) == ("FAIL", [], "autonomy/twin")
    assert said in run["reason"]


@pytest.mark.usefixtures("forked_workers")
def test_a_process_that_a_thread_of_the_autonomy_ends_is_not_flown_again(tmp_path: Path) -> None:
    path = write_hover(tmp_path)
    ends = "self.left = 10**9; threading.Timer(0.05, os._exit, (4,)).start()"
    (tmp_path / "still.py").write_text(ONCE.replace("WHAT", ends))
    path.write_text(path.read_text().replace("repetitions: 2", "repetitions: 1\nretries: 1"))
    assert main(["run", str(path), "--out", str(tmp_path / "out")]) in {1, 3}  # in a call, or not
    (summary,) = (tmp_path / "out" / "hover").glob("*/summary.json")
    (run,) = json.loads(summary.read_text("utf-8"))["runs"]
    assert (run["verdict"] in {"FAIL", "ERROR"}, run["attempts"]) == (True, [])


def lost(folder: Path, log: str, **how: Any) -> RunResult:
    (folder / "log.jsonl").write_text(log)
    return lost_result(plan_in(folder), WorkerLost(LOST, **how), folder)


def plan_in(folder: Path) -> RunPlan:
    return load_campaign(write_hover(folder)).runs[0]


@pytest.mark.parametrize(
    ("log", "how", "verdict", "is_due"),
    [
        ("", {"is_own_end": True}, "ERROR", True),
        ("", {"is_own_end": True, "called": "twin"}, "FAIL", False),  # its files are not here
        (CLIMB, {"is_own_end": True, "called": "twin"}, "ERROR", True),  # it had no goal yet
        (CLIMB, {"is_own_end": True, "called": "twin", "has_goal": True}, "FAIL", False),
        (CLIMB, {"no_retry": "it is FAIL"}, "ERROR", False),
        (GOAL, {}, "ERROR", True),  # its node was lost
        (GOAL, {"called": "twin"}, "ERROR", True),
        (GOAL, {"is_own_end": True}, "ERROR", False),
        (GOAL, {"is_own_end": True, "called": "twin"}, "FAIL", False),
        (GOAL + INVALID, {"is_own_end": True, "called": "twin"}, "INVALID", False),
        (GOAL + TOUCHED, {}, "FAIL", False),
        (GOAL + INVALID + TOUCHED, {}, "INVALID", False),
        (GOAL + INVALID, {}, "INVALID", True),
        (GOAL + FAULT, {}, "ERROR", False),
        (GOAL + ABORTED, {}, "ERROR", True),  # by itself, as its parent was lost
        (GOAL + ABORTED + TOUCHED, {}, "ERROR", False),
        (GOAL + TOUCHED + '{"t_s": 22.0, "ev', {}, "FAIL", False),  # and was cut
    ],
)
def test_a_lost_run_keeps_the_verdict_that_it_had_decided(
    tmp_path: Path, log: str, how: dict[str, Any], verdict: str, is_due: bool
) -> None:
    result = lost(tmp_path, log, **how)
    assert (result.verdict, retry_due(result, retries=1)) == (verdict, is_due)
    reasons = (result.reason, *(one.reason for one in result.also))
    assert any(LOST in text for text in reasons), "the loss itself is said, too"


def test_an_exception_before_the_loss_still_keeps_the_exit_code_from_0(tmp_path: Path) -> None:
    assert lost(tmp_path, GOAL + TOUCHED + FAULT).exceptions == ("flight: KeyError: 1",)


def test_a_flight_that_was_invalid_and_then_touched_the_gate_is_not_flown_again(
    fly_run: Fly,
) -> None:
    """It flies beside the middle of the gate, into its side."""

    def disturb(_: VehiclePair, run_state: RunState) -> None:
        def decide(stage: str, _: float) -> None:
            if stage == "goal":
                run_state.decide("INVALID", "for the test", ends_flight=False)

        run_state.on_stage(decide)

    ahead = "autonomy={use: autonomies/straight.py:StraightAutonomy, with: {for_s: 6}}"
    aside = "world.objects.gate.pose.east_m=0.6"
    result, _ = fly_run(mode="sim", sets=(ahead, aside), disturb=disturb)
    assert (result.verdict, result.reason) == ("INVALID", "for the test")
    assert result.no_retry.startswith("the subject failed, too: twin touched gate.")
    assert not retry_due(result, retries=1)


@pytest.mark.parametrize(("ends", "no_retry"), [(True, ""), (False, "reached of twin failed")])
def test_a_goal_missed_since_the_flight_was_ended_is_no_failure(
    fly_run: Fly, ends: bool, no_retry: str
) -> None:
    """Where the flight went on to its end and did not reach the gate, that is one."""

    def disturb(_: VehiclePair, run_state: RunState) -> None:
        def decide(stage: str, _: float) -> None:
            if stage == "goal":
                run_state.decide("INVALID", "for the test", ends_flight=ends)

        run_state.on_stage(decide)

    short = "autonomy={use: autonomies/straight.py:StraightAutonomy, with: {for_s: 1}}"
    result, _ = fly_run(mode="sim", sets=(short,), disturb=disturb)
    assert result.verdict == "INVALID"
    assert no_retry in result.no_retry
    assert retry_due(result, retries=1) is ends
