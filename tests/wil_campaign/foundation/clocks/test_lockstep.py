"""The clock that waits for whoever is late: nobody is ahead of it, and it of nobody by much.

The processes here are values: each has its own delay until it hears a piece, and until it works.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wil_campaign.foundation.clocks.lockstep import LEAD_S, REPORT_S, Lockstep
from wil_campaign.foundation.clocks.sim_clock_controller import STALL_S, STEP_S, ClockSegment

NOMINAL = 4.0
_TICK_S = 0.0005
_BEGIN_S = 100.0
_NO_WORD = ClockSegment(0.0, 0.0, 1.0)


@dataclass
class Process:
    """One that follows: it works when `busy` does not keep it from it, and hears then."""

    name: str
    busy: Callable[[float], bool]
    segment: ClockSegment = _NO_WORD
    done_s: float = _BEGIN_S
    reported_s: float = _BEGIN_S
    heard: list[ClockSegment] = field(default_factory=list)

    def turn(self, wall_s: float) -> float | None:
        """Do what is due; return what is to be reported."""
        if self.busy(wall_s):
            return None
        for piece in self.heard:
            assert piece.at(wall_s) >= self.done_s - 1e-9, "its clock would go back"
            self.segment = piece
        self.heard.clear()
        self.done_s = max(self.done_s, self.segment.at(wall_s))
        if self.done_s < self.reported_s + REPORT_S:
            return None
        self.reported_s = self.done_s
        return self.done_s


@dataclass
class Flown:
    """What clock and processes did: by the wall, the clock's time, and how far each had come."""

    wall_s: list[float] = field(default_factory=list)
    run_s: list[float] = field(default_factory=list)
    done_s: list[tuple[float, ...]] = field(default_factory=list)

    @property
    def pace(self) -> float:
        return (self.run_s[-1] - self.run_s[0]) / (self.wall_s[-1] - self.wall_s[0])


def flown(busy: Sequence[Callable[[float], bool]], *, for_s: float = 4.0) -> Flown:
    lockstep, out = Lockstep(nominal=NOMINAL), Flown()
    processes = [Process(str(index), one) for index, one in enumerate(busy)]
    for process in processes:
        lockstep.join(process.name)
    lockstep.begin(ClockSegment(0.0, _BEGIN_S, 1.0))
    for process in processes:
        process.heard.append(lockstep.segment)
    for tick in range(1, round(for_s / _TICK_S)):
        wall_s = tick * _TICK_S
        for process in processes:
            reached_s = process.turn(wall_s)
            if reached_s is None:
                continue
            lockstep.report(process.name, reached_s)
            if lockstep.extend(wall_s):
                for each in processes:
                    each.heard.append(lockstep.segment)
        out.wall_s.append(wall_s)
        out.run_s.append(lockstep.segment.at(wall_s))
        out.done_s.append(tuple(process.done_s for process in processes))
    return out


def holds(out: Flown) -> None:
    """Assert that nobody was ahead of the clock, nor far behind it, and that it went on."""
    for before_s, run_s, done_s in zip(out.run_s, out.run_s[1:], out.done_s[1:], strict=False):
        assert 0.0 <= run_s - before_s + 1e-9 <= NOMINAL * _TICK_S + 2e-9
        assert max(done_s) <= run_s + 1e-9
        # It has done more than it has reported.
        assert run_s - min(done_s) <= LEAD_S + 1e-9


def test_processes_that_are_in_time_run_on_one_line_at_the_pace_that_was_asked_for() -> None:
    out = flown([lambda _: False, lambda _: False])
    holds(out)
    assert out.pace == pytest.approx(NOMINAL, rel=0.01)


def test_the_clock_waits_for_a_late_client_and_makes_no_leap_after_it() -> None:
    out = flown([lambda _: False, lambda wall_s: 1.0 < wall_s < 1.5])
    holds(out)
    stood = [
        run_s for wall_s, run_s in zip(out.wall_s, out.run_s, strict=True) if 1.1 < wall_s < 1.5
    ]
    assert max(stood) == min(stood)
    assert out.pace == pytest.approx(NOMINAL * 3.5 / 4.0, rel=0.05)


@settings(max_examples=25, deadline=None)
@given(
    st.lists(
        st.lists(st.tuples(st.floats(0.0, 2.0), st.floats(0.001, 0.3)), max_size=8),
        min_size=1,
        max_size=4,
    )
)
def test_a_late_client_is_left_behind_by_no_other(
    delays: list[list[tuple[float, float]]],
) -> None:
    def busy(late: list[tuple[float, float]]) -> Callable[[float], bool]:
        return lambda wall_s: any(at_s <= wall_s < at_s + for_s for at_s, for_s in late)

    out = flown([busy(late) for late in delays], for_s=3.0)
    holds(out)
    least_s = 3.0 - sum(for_s for late in delays for _, for_s in late)
    assert out.run_s[-1] - _BEGIN_S >= NOMINAL * least_s * 0.9 - 2.0 * LEAD_S * len(delays) * 8


def test_an_extension_leaves_the_line_as_it_is() -> None:
    lockstep = Lockstep(nominal=NOMINAL)
    lockstep.join("real")
    lockstep.begin(ClockSegment(50.0, 70.0, 1.0))
    first = lockstep.segment
    assert (first.wall_s, first.run_s, first.rate) == (50.0, 70.0, NOMINAL)
    assert first.end_s == pytest.approx(70.0 + LEAD_S)
    lockstep.report("real", 70.02)
    assert lockstep.extend(50.006)
    second = lockstep.segment
    assert (second.wall_s, second.run_s, second.rate) == (50.0, 70.0, NOMINAL)
    assert second.end_s == pytest.approx(70.02 + LEAD_S)
    lockstep.report("real", second.end_s)
    assert lockstep.extend(51.0)
    assert lockstep.segment.wall_s == 51.0
    assert lockstep.segment.run_s == pytest.approx(second.end_s)


def test_a_client_that_hangs_is_found_by_the_wall_and_not_awaited_until_it_reports() -> None:
    lockstep = Lockstep(nominal=NOMINAL)
    for name in ("real", "orchestrator"):
        lockstep.join(name)
    lockstep.begin(ClockSegment(0.0, 0.0, 1.0))
    wall_s = 0.0
    while not lockstep.is_silent("orchestrator", wall_s, STALL_S):
        wall_s += STEP_S
        lockstep.step()
        lockstep.report("real", lockstep.segment.at(wall_s))
        lockstep.extend(wall_s)
        assert lockstep.segment.end_s == pytest.approx(LEAD_S)
    assert STALL_S < wall_s < STALL_S + 3.0 * STEP_S
    # It stands where the clock does, and waits itself.
    assert not lockstep.is_silent("real", wall_s, STALL_S)
    lockstep.give_up("orchestrator")
    assert not lockstep.is_silent("orchestrator", wall_s + 100.0, STALL_S)
    lockstep.report("real", lockstep.segment.end_s)
    assert lockstep.extend(wall_s)
    assert lockstep.segment.end_s == pytest.approx(2.0 * LEAD_S)
    # Only from now on does it wait for this one.
    lockstep.step()
    assert not lockstep.is_silent("real", wall_s + STEP_S, STALL_S)
    lockstep.report("orchestrator", LEAD_S)
    lockstep.report("real", lockstep.segment.end_s)
    assert not lockstep.extend(wall_s + 1.0)


def test_a_machine_that_was_asleep_has_stalled_nobody() -> None:
    lockstep = Lockstep(nominal=NOMINAL)
    lockstep.join("real")
    lockstep.begin(ClockSegment(0.0, 0.0, 1.0))
    for step in range(10):
        lockstep.step()
        assert not lockstep.is_silent("real", 3600.0 + step * STEP_S, STALL_S)


def test_a_client_that_has_ended_is_not_waited_for() -> None:
    lockstep = Lockstep(nominal=NOMINAL)
    for name in ("guard", "real"):
        lockstep.join(name)
    lockstep.begin(ClockSegment(0.0, 0.0, 1.0))
    lockstep.report("guard", LEAD_S)
    assert not lockstep.extend(0.1)
    lockstep.leave("real")
    lockstep.report("real", 0.01)
    assert lockstep.extend(0.1)
    assert lockstep.segment.end_s == pytest.approx(2.0 * LEAD_S)
