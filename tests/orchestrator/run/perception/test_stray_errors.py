"""What the autonomy raises beside its calls decides its run: Python would print it and go on."""

import asyncio
import sys
import threading
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from wil_campaign.orchestrator.run.perception.stray_errors import StrayErrors
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.vehicles.autonomy import Command
from wil_campaign.vehicles.setpoints import VelocitySetpoint
from wil_campaign.worlds.frames import quat_from_euler

Fly = Callable[..., tuple[RunResult, Path]]


def boom() -> None:
    raise KeyError("gone")


async def boom_later() -> None:
    boom()


class Breaks:
    """Breaks when it is freed."""

    def __del__(self) -> None:
        boom()


def break_in_thread() -> None:
    thread = threading.Thread(target=boom)
    thread.start()
    thread.join()


def break_in_task() -> None:
    KEPT.append(asyncio.get_running_loop().create_task(boom_later(), name="planner"))


def break_in_callback() -> None:
    asyncio.get_running_loop().call_soon(boom)


KEPT: list[object] = []
WAYS: Mapping[str, Callable[[], object]] = {
    "thread": break_in_thread,
    "task": break_in_task,
    "callback": break_in_callback,
    "freed": Breaks,
}


class Still:
    """An autonomy that hovers, and breaks somewhere beside its tenth call."""

    def __init__(self, *, parameters: Mapping[str, object], **_: object) -> None:
        self._break = WAYS[str(parameters["way"])]
        self._calls = 0

    def perceive(self, reading: object) -> None:
        pass

    def act(self, telemetry: object) -> Command:
        self._calls += 1
        if self._calls == 10:
            self._break()
        return Command(VelocitySetpoint((0.0, 0.0, 0.0)), done=self._calls > 20)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("way", WAYS)
def test_an_error_outside_of_a_call_is_a_failure_of_the_autonomy(
    fly_run: Fly, monkeypatch: pytest.MonkeyPatch, way: str
) -> None:
    monkeypatch.setattr(
        "wil_campaign.campaigns.setup.autonomy_under_test.find_autonomy", lambda *_: Still
    )
    sets = (
        f"autonomy={{use: place, with: {{way: {way}}}}}",
        "oracles={landed: {}, reached: {required: false}}",
    )
    result, _ = fly_run(mode="sim", sets=sets, has_cameras=False)
    assert (result.verdict, result.decided_by) == ("FAIL", "autonomy/twin"), result.reason
    said = "the autonomy of twin crashed beside its calls: KeyError: 'gone' ("
    assert result.reason.startswith(said)
    assert "test_stray_errors.py:" in result.reason
    assert (result.exceptions, "boom" in result.trace) == ((), True)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_thread_of_ours_that_raises_is_an_error_and_hooks_are_given_back() -> None:
    run_state = RunState(time=lambda: 1.0)
    before = threading.excepthook, sys.unraisablehook
    with StrayErrors(run_state, "real"):
        wrong: tuple[object, ...] = ("not", "angles", 0.0)
        thread = threading.Thread(target=quat_from_euler, args=wrong, name="renderer")
        thread.start()
        thread.join()
        assert not run_state.decisive, "the main thread decides"
    (event,) = run_state.decisive
    assert (event.kind, event.source) == ("ERROR", "exception")
    assert event.text.startswith("thread renderer: TypeError: ")
    assert (threading.excepthook, sys.unraisablehook) == before


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_recipe_step_s_thread_is_an_error_and_no_failure_of_the_autonomy_beside_it() -> None:
    run_state = RunState(time=lambda: 1.0)
    run_state.autonomy_folders.add(Path(__file__).parent)
    run_state.step_files = frozenset({Path(__file__)})
    with StrayErrors(run_state, "real"):
        break_in_thread()
    (event,) = run_state.decisive
    assert (event.kind, event.source) == ("ERROR", "mixing")
    said = "a step of the recipe crashed beside its calls: KeyError: 'gone' ("
    assert event.text.startswith(said)
    assert "test_stray_errors.py:" in event.text
