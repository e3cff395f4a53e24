"""Whatever the autonomy under test does or answers, it is its fault, and told with its place."""

import asyncio
import contextlib
import json
import math
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wil_campaign.api import rotate
from wil_campaign.campaigns.autonomies.straight import StraightAutonomy
from wil_campaign.orchestrator.run.perception.autonomy_calls import (
    AutonomyFault,
    call_autonomy,
    checked_command,
    require_method_ran,
)
from wil_campaign.orchestrator.run_results.attempts import retry_due
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.vehicles.autonomy import Command
from wil_campaign.vehicles.setpoints import PositionSetpoint, VelocitySetpoint

Fly = Callable[..., tuple[RunResult, Path]]
STILL = VelocitySetpoint((0.0, 0.0, 0.0))


def raising(error: BaseException) -> Callable[[], Any]:
    def ask() -> Any:
        raise error

    return ask


class WordlessError(Exception):
    def __str__(self) -> str:
        raise ValueError("not even that")


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (ZeroDivisionError("one half of nothing"), "ZeroDivisionError: one half of nothing"),
        (SystemExit(0), "SystemExit: 0"),
        (KeyboardInterrupt(), "KeyboardInterrupt"),
        (asyncio.CancelledError(), "CancelledError"),
        (GeneratorExit(), "GeneratorExit"),
        (StopIteration(), "StopIteration"),
        (WordlessError(), "WordlessError: (its message cannot be shown)"),
        (RuntimeError("two\nlines, \x1b[31mred \ud800"), "RuntimeError: two lines, ?[31mred ?"),
    ],
)
def test_any_exception_of_a_call_is_a_fault_of_the_autonomy(
    error: BaseException, said: str
) -> None:
    with pytest.raises(AutonomyFault) as caught:
        call_autonomy(raising(error))
    text = str(caught.value)
    assert text.startswith(f"crashed: {said} (")
    assert "test_autonomy_calls.py:" in text
    text.encode()


def test_the_place_is_in_the_users_file_where_our_library_raised() -> None:
    """Also where our packages are run from their sources, as here."""
    with pytest.raises(AutonomyFault) as caught:
        call_autonomy(lambda: rotate(1.0, (0.0, 0.0, 1.0)))  # type: ignore[arg-type]
    assert f"({__file__}:" in str(caught.value)
    assert "frames.py" in caught.value.trace, "the traceback has all of it"


def test_an_autonomy_that_we_ship_is_under_test_too() -> None:
    with pytest.raises(AutonomyFault, match=r"autonomies/straight\.py:\d+"):
        call_autonomy(lambda: StraightAutonomy(goal={}, parameters={"pace": 1}, seed=0))


def test_long_words_are_cut() -> None:
    with pytest.raises(AutonomyFault) as caught:
        call_autonomy(raising(RuntimeError("x" * 100_000)))
    assert len(str(caught.value)) < 1000


def spinning() -> None:
    while True:
        try:
            math.sqrt(2.0)
        except Exception:  # noqa: BLE001, S112 - as users write it
            continue


@pytest.mark.parametrize("hang", [spinning, lambda: time.sleep(60.0)])
def test_an_autonomy_that_hangs_gave_no_answer(hang: Callable[[], None]) -> None:
    with pytest.raises(
        AutonomyFault,
        match=r"gave no answer within 0\.05 s, its limit \(.*call_s\) \(.*test_autonomy_calls\.py:",
    ):
        call_autonomy(hang, within_s=0.05)


def test_a_call_that_ends_with_a_long_operation_gave_no_answer_either() -> None:
    """Its alarm comes when the operation is over, which may be after the call."""

    class Slow:
        def __init__(self) -> None:
            self.image = np.full((1500, 1500), 2.0)

        def perceive(self) -> None:
            self.image = self.image**0.37

    with pytest.raises(AutonomyFault, match=r"gave no answer within 0\.001 s, its limit"):
        call_autonomy(Slow().perceive, within_s=0.001)


class Undecided:
    """Neither true nor false, no number, not three: as a tensor of several values."""

    def __bool__(self) -> bool:
        raise RuntimeError("ambiguous")

    def __float__(self) -> float:
        raise RuntimeError("ambiguous")

    def __iter__(self) -> Iterator[float]:
        raise RuntimeError("ambiguous")


def test_an_alarm_after_the_end_of_a_call_does_not_interrupt_its_clean_up() -> None:
    """Else the timer stays on, and the next alarm interrupts the run: a landing, maybe."""

    before = signal.getsignal(signal.SIGALRM)
    for k in range(300):
        with contextlib.suppress(AutonomyFault):
            call_autonomy(lambda: 7, within_s=1e-6 * (1 + k % 30))
        _, every_s = signal.getitimer(signal.ITIMER_REAL)
        assert every_s == 0.0
        assert signal.getsignal(signal.SIGALRM) is before


def test_a_timer_of_other_code_goes_on() -> None:
    heard: list[int] = []
    before = signal.signal(signal.SIGALRM, lambda number, _: heard.append(number))
    earlier = signal.setitimer(signal.ITIMER_REAL, 3600.0)
    try:
        assert call_autonomy(lambda: 7) == 7
        left_s, _ = signal.getitimer(signal.ITIMER_REAL)
        assert 3000.0 < left_s <= 3600.0
        signal.raise_signal(signal.SIGALRM)
        assert heard == [signal.SIGALRM]
    finally:
        signal.setitimer(signal.ITIMER_REAL, *earlier)
        signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (None, "returned nothing, not a Command"),
        (STILL, "returned a VelocitySetpoint, not a Command"),
        (Command("up"), "whose setpoint is a str"),  # type: ignore[arg-type]
        (Command(None), "whose setpoint is nothing"),  # type: ignore[arg-type]
        (Command(VelocitySetpoint((math.nan, 0.0, 0.0))), "velocity_ned_m_s is not finite (nan)"),
        (Command(VelocitySetpoint((0.0, math.inf, 0.0))), "velocity_ned_m_s is not finite (inf)"),
        (Command(VelocitySetpoint((0.0, 0.0, 1e39))), "is beyond 1e+06 (1e+39)"),
        (Command(VelocitySetpoint((0.0, 0.0, 10**400))), "contains a int"),
        (Command(VelocitySetpoint((0.0, 0.0))), "is not three numbers"),  # type: ignore[arg-type]
        (Command(VelocitySetpoint(("1", 2.0, 3.0))), "contains a str"),  # type: ignore[arg-type]
        (Command(VelocitySetpoint(3.0)), "is not three numbers"),  # type: ignore[arg-type]
        (Command(VelocitySetpoint((0.0, 0.0, 0.0), yaw_rad=math.nan)), "yaw_rad is not finite"),
        (Command(VelocitySetpoint((0.0, 0.0, 0.0), 0.0, 0.0)), "both yaw_rad and yaw_rate_rad_s"),
        (Command(PositionSetpoint((math.nan, 0.0, 0.0))), "position_ned_m is not finite"),
        (Command(STILL, note={"a": 1}), "a note that is a dict"),  # type: ignore[arg-type]
        (Command(STILL, done=np.zeros(2)), "a done that is a ndarray"),  # type: ignore[arg-type]
        (Command(STILL, done="no"), "a done that is a str, not True"),  # type: ignore[arg-type]
        (Command(STILL, done=1), "a done that is a int, not True"),  # type: ignore[arg-type]
        (Command(STILL, done=None), "a done that is nothing, not True"),  # type: ignore[arg-type]
        (Command(VelocitySetpoint((0.0, 0.0, 0.0), False)), "yaw_rad contains a bool"),
        (Command(VelocitySetpoint((b"1", 0.0, 0.0))), "contains a bytes"),  # type: ignore[arg-type]
        (Command(STILL, done=Undecided()), "a done that is a Undecided"),  # type: ignore[arg-type]
        (Command(VelocitySetpoint(Undecided())), "is not three numbers"),  # type: ignore[arg-type]
        (Command(VelocitySetpoint((0.0, Undecided(), 0.0))), "contains a Undecided"),  # type: ignore[arg-type]
    ],
)
def test_an_answer_that_no_vehicle_can_fly_is_a_fault(answer: object, said: str) -> None:
    with pytest.raises(AutonomyFault) as caught:
        checked_command(answer)
    assert said in str(caught.value)


def test_numbers_of_numpy_become_plain_ones() -> None:
    vector: Any = np.array([1.0, 2.0, 3.0], dtype=np.float32)
    turn: Any = np.float64(0.5)
    command = checked_command(Command(VelocitySetpoint(vector, turn), done=np.bool_(True)))  # type: ignore[arg-type]
    assert command == Command(VelocitySetpoint((1.0, 2.0, 3.0), 0.5), done=True)
    assert type(command.setpoint) is VelocitySetpoint
    assert {type(x) for x in command.setpoint.velocity_ned_m_s} == {float}
    assert type(command.done) is bool


def test_a_note_is_one_short_line() -> None:
    note = checked_command(Command(STILL, note="a\nb\x1b" + "c" * 200)).note
    assert note.startswith("a?b?ccc")
    assert len(note) == 80


class Doing:
    """An autonomy whose every act is `do`."""

    do: Callable[[], object]

    def __init__(self, **_: object) -> None:
        pass

    def perceive(self, reading: object) -> None:
        pass

    def act(self, telemetry: object) -> object:
        return type(self).do()


@pytest.mark.parametrize(
    ("do", "said"),
    [
        (lambda: None, "the autonomy of real returned nothing, not a Command"),
        (
            lambda: Command(VelocitySetpoint((math.nan, 0.0, 0.0))),
            "the autonomy of real returned a setpoint whose velocity_ned_m_s is not finite (nan)",
        ),
        (raising(SystemExit(0)), "the autonomy of real crashed: SystemExit: 0 ("),
        (raising(asyncio.CancelledError()), "the autonomy of real crashed: CancelledError ("),
    ],
)
def test_a_faulty_autonomy_fails_the_run_and_all_land(
    fly_run: Fly, monkeypatch: pytest.MonkeyPatch, do: Callable[[], object], said: str
) -> None:
    monkeypatch.setattr(
        "wil_campaign.campaigns.setup.autonomy_under_test.find_autonomy", lambda *_: Doing
    )
    monkeypatch.setattr(Doing, "do", staticmethod(do), raising=False)
    result, folder = fly_run(sets=("oracles={landed: {}, reached: {}}",))
    assert result.verdict == "FAIL"
    assert result.reason.startswith(said)
    (landed,) = [o for o in result.oracles if (o.name, o.vehicle) == ("landed", "real")]
    assert landed.verdict == "PASS"
    stages = [
        line["stage"]
        for line in map(json.loads, (folder / "log.jsonl").read_text("utf-8").splitlines())
        if line["event"] == "stage"
    ]
    assert stages[-2:] == ["landed", "end"]


def test_an_autonomy_that_cannot_be_built_for_a_run_is_an_error_that_retries_do_not_hide(
    fly_run: Fly, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Picky:
        def __init__(self, *, seed: int, **_: object) -> None:
            if seed != 0:  # with which the file is checked
                raise RuntimeError("not this seed")

        def perceive(self, reading: object) -> None:
            pass

        def act(self, telemetry: object) -> object:
            return Command(STILL)

    monkeypatch.setattr(
        "wil_campaign.campaigns.setup.autonomy_under_test.find_autonomy", lambda *_: Picky
    )
    result, _ = fly_run(mode="sim")
    assert result.verdict == "ERROR", (result.reason, result.also)
    assert result.reason.startswith("the autonomy of twin crashed: RuntimeError: not this seed (")
    assert not retry_due(result, retries=1)


async def perceives_later(_: object) -> None:
    raise AssertionError("its body never runs")


def perceives_lazily(_: object) -> Iterator[None]:
    yield


@pytest.mark.parametrize("perceive", [perceives_later, perceives_lazily])
def test_a_method_whose_body_does_not_run_is_a_fault(perceive: Callable[[object], object]) -> None:
    """Its vehicle would fly blind, and nobody would notice."""
    with pytest.raises(AutonomyFault, match="from perceive, whose body did not run: write a plain"):
        require_method_ran(perceive(None), "perceive")
    require_method_ran(7, "perceive")
