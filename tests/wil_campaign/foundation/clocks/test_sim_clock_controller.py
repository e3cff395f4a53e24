"""The run clock that follows a simulator's time: never back, never a jump, and where it should be.

The simulators here are values: how fast they run at each moment of the wall's time.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from wil_campaign.foundation.clocks.sim_clock_controller import (
    STALL_S,
    STEP_S,
    BootTrack,
    ClockDivergence,
    ClockSegment,
    SimClockController,
)

Rate = Callable[[float, float, float], float]
"""Of a simulator: by the wall's time, the run clock's rate, and how far it is behind that."""
_TICK_S = 0.005


@dataclass
class Flown:
    """What a clock did: time of the wall, of the simulator, of the run; and its rate."""

    wall_s: list[float]
    boot_s: list[float]
    run_s: list[float]
    rate: list[float]
    steering: SimClockController

    def off_s(self, at_s: float) -> float:
        """Run minus simulator."""
        index = round(at_s / _TICK_S) - 1
        return self.run_s[index] - self.boot_s[index]


def flown(
    rate: Rate,
    *,
    nominal: float,
    for_s: float = 20.0,
    late_s: float = 0.02,
    seed: int = 0,
) -> Flown:
    rng = np.random.default_rng(seed)
    steering = SimClockController(nominal=nominal)
    steering.begin(ClockSegment(0.0, 100.0, 1.0))
    out = Flown([], [], [], [], steering)
    boot_s, stamp_s, under_way = 0.0, 0.0, list[tuple[float, float]]()
    for tick in range(1, round(for_s / _TICK_S) + 1):
        wall_s = tick * _TICK_S
        boot_s += (
            rate(wall_s, steering.segment.rate, steering.segment.at(wall_s) - 100.0 - boot_s)
            * _TICK_S
        )
        while boot_s >= stamp_s:
            under_way.append((wall_s + rng.uniform(0.0, late_s), stamp_s))
            stamp_s += 0.02
        for arrival in [one for one in under_way if one[0] <= wall_s]:
            steering.track.received(*arrival)
            under_way.remove(arrival)
        if tick % round(STEP_S / _TICK_S) == 0:
            steering.step(wall_s)
        out.wall_s.append(wall_s)
        out.boot_s.append(boot_s)
        out.run_s.append(steering.segment.at(wall_s))
        out.rate.append(steering.segment.rate)
    return out


def follows_smoothly(out: Flown, nominal: float) -> None:
    """Assert that the clock never went back, and never went faster than it may."""
    steps = np.diff(out.run_s)
    assert steps.min() >= -1e-9
    assert steps.max() <= 2.0 * nominal * _TICK_S + 1e-9
    # It gathers pace without a leap; for a simulator that falls silent it stops at once.
    assert np.diff(out.rate).max() <= 4.0 * nominal * STEP_S + 1e-6


@settings(max_examples=25, deadline=None)
@given(
    attained=st.floats(0.3, 1.1),
    nominal=st.floats(1.0, 20.0),
    late_s=st.floats(0.0, 0.06),
    seed=st.integers(0, 99),
)
@example(attained=1.078125, nominal=20.0, late_s=0.0546875, seed=0)  # stamps overtake: no reboots
def test_it_goes_as_fast_as_the_simulator_attains(
    attained: float, nominal: float, late_s: float, seed: int
) -> None:
    rate = attained * nominal
    out = flown(lambda *_: rate, nominal=nominal, for_s=10.0, late_s=late_s, seed=seed)
    follows_smoothly(out, nominal)
    assert np.mean(out.rate[-400:]) == pytest.approx(rate, rel=0.03)
    # After it has found its pace it stays by the simulator, however late stamps come.
    assert abs(out.off_s(10.0) - out.off_s(5.0)) < 0.03 * rate + 0.02


@settings(max_examples=20, deadline=None)
@given(st.lists(st.floats(0.0, 12.0), min_size=3, max_size=12), st.integers(0, 99))
def test_time_goes_on_and_never_back_at_any_rate_of_the_simulator(
    rates: list[float], seed: int
) -> None:
    out = flown(
        lambda wall_s, *_: rates[int(wall_s) % len(rates)], nominal=10.0, for_s=12.0, seed=seed
    )
    follows_smoothly(out, 10.0)


def test_a_simulator_that_hesitates_has_time_wait_for_it() -> None:
    out = flown(lambda wall_s, *_: 0.0 if 10.0 < wall_s < 12.0 else 5.0, nominal=5.0)
    follows_smoothly(out, 5.0)
    usual_s = out.off_s(9.9)
    assert out.off_s(11.9) - usual_s < 0.8
    assert out.rate[round(11.9 / _TICK_S)] < 0.05
    assert out.off_s(18.0) == pytest.approx(usual_s, abs=0.1)
    assert not out.steering.stalled


def test_a_simulator_that_hangs_is_reported_and_time_goes_on() -> None:
    out = flown(lambda wall_s, *_: 0.0 if wall_s > 6.0 else 5.0, nominal=5.0, for_s=14.0)
    assert out.steering.stalled
    assert out.rate[round((6.0 + STALL_S - 0.2) / _TICK_S)] < 0.05
    # Who waits for a landing or an end has to be able to give up.
    assert out.rate[-1] == pytest.approx(5.0, rel=0.05)


def test_a_machine_that_was_asleep_has_stalled_nobody() -> None:
    steering = SimClockController(nominal=4.0)
    steering.begin(ClockSegment(0.0, 0.0, 1.0))
    for step in range(40):
        steering.track.received(step * STEP_S, step * STEP_S)
        steering.step(step * STEP_S)
    for step in range(10):
        steering.step(3600.0 + step * STEP_S)
    assert not steering.stalled


def test_a_reboot_begins_the_vehicle_s_time_anew_and_not_ours() -> None:
    steering = SimClockController(nominal=2.0)
    steering.begin(ClockSegment(0.0, 50.0, 1.0))
    run_s = []
    for step in range(200):
        wall_s = step * STEP_S
        boot_s = 30.0 + 2.0 * wall_s if wall_s < 5.0 else 2.0 * (wall_s - 5.0)
        steering.track.received(wall_s, boot_s)
        run_s.append(steering.step(wall_s).run_s)
    assert np.diff(run_s).min() >= 0.0
    assert steering.track.reboots == 1
    assert steering.segment.rate == pytest.approx(2.0, rel=0.02)


def test_frames_that_waited_in_a_buffer_count_once() -> None:
    track = BootTrack(nominal=2.0)
    for step in range(100):
        wall_s = round(step // 10) * 0.1 + 0.1
        track.received(wall_s, step * 0.02)
    boot_s, rate = track.line(1.0)
    assert rate == pytest.approx(2.0, rel=0.02)
    assert boot_s == pytest.approx(1.98, abs=0.02)


@pytest.mark.parametrize(("drift", "apart"), [(0.0, False), (0.005, False), (0.1, True)])
def test_a_vehicle_whose_time_leaves_ours_is_reported(drift: float, apart: bool) -> None:
    track, look = BootTrack(nominal=5.0), ClockDivergence()
    told = False
    for step in range(600):
        wall_s = step * STEP_S
        track.received(wall_s, 5.0 * wall_s * (1.0 - drift))
        told = look.look(track, wall_s=wall_s, run_s=5.0 * wall_s) or told
    assert told is apart
    if apart:
        assert look.off_s < -1.0


def test_a_hiccup_is_let_go() -> None:
    track, look = BootTrack(nominal=5.0), ClockDivergence()
    told = False
    for step in range(600):
        wall_s = step * STEP_S
        if not 10.0 < wall_s < 10.5:
            track.received(wall_s, 5.0 * wall_s)
        told = look.look(track, wall_s=wall_s, run_s=5.0 * wall_s) or told
    assert not told


def test_a_piece_ends_where_it_holds_no_longer() -> None:
    piece = ClockSegment(10.0, 100.0, 4.0, holds_s=0.5)
    assert [piece.at(wall_s) for wall_s in (9.0, 10.25, 11.0, 50.0)] == [100.0, 101.0, 102.0, 102.0]
