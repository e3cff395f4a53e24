"""The clock mapping: within its own bound, whatever the latency, drift and steps."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicles.clocks.timesync import ClockMap, VehicleClock

latencies_s = st.floats(0.0, 0.3)


def _exchange(
    clock: ClockMap, *, t_s: float, there_s: float, back_s: float, offset_s: float, drift: float,
    step_s: float = 0.0,
) -> None:  # fmt: skip
    stamped_s = (t_s + there_s) * (1.0 + drift) + offset_s
    if step_s:
        stamped_s = math.floor(stamped_s / step_s) * step_s
    clock.add(
        t_sent_s=t_s, t_received_s=t_s + there_s + back_s, remote_ns=max(0, round(stamped_s * 1e9))
    )


@given(
    ways=st.lists(st.tuples(latencies_s, latencies_s), min_size=1, max_size=60),
    offset_s=st.floats(1.0, 1e5),
    drift=st.floats(-0.015, 0.015),
)
def test_the_error_stays_within_the_bound_it_gives(
    ways: list[tuple[float, float]], offset_s: float, drift: float
) -> None:
    clock = ClockMap()
    t_s = 1000.000123456
    for there_s, back_s in ways:
        _exchange(clock, t_s=t_s, there_s=there_s, back_s=back_s, offset_s=offset_s, drift=drift)
        now_s = t_s + there_s
        error_s = clock.run_time(now_s * (1.0 + drift) + offset_s) - now_s
        assert abs(error_s) <= clock.uncertainty_s + 1e-6
        t_s += 0.487000321
    assert clock.resets == 0
    assert clock.uncertainty_s <= (ways[-1][0] + ways[-1][1]) / 2.0 + 1e-9


@given(
    jitter=st.lists(
        st.tuples(st.floats(0.0, 0.04), st.floats(0.0, 0.04)), min_size=40, max_size=40
    ),
    drift=st.floats(-1e-4, 1e-4),
)
def test_jitter_is_filtered_out(jitter: list[tuple[float, float]], drift: float) -> None:
    clock = ClockMap(max_drift=2e-4)
    t_s = 0.000123456
    quick = [(0.0, 0.0), *jitter[1:20], (0.0, 0.0), *jitter[21:-1], (0.0, 0.0)]
    for there_s, back_s in quick:
        _exchange(
            clock,
            t_s=t_s,
            there_s=0.002 + there_s,
            back_s=0.002 + back_s,
            offset_s=50.0,
            drift=drift,
        )
        t_s += 0.500000321
    assert clock.uncertainty_s < 0.0025
    assert abs(clock.run_time(t_s * (1.0 + drift) + 50.0) - t_s) < 0.0025


def test_drift_is_measured() -> None:
    clock = ClockMap()
    for number in range(40):
        _exchange(clock, t_s=number * 0.5, there_s=0.001, back_s=0.001, offset_s=7.0, drift=-0.012)
    estimate = clock.estimate()
    assert estimate.drift_ppm == pytest.approx(-12_000, abs=200)
    assert estimate.exchanges == 40
    # At the newest exchange: 7 s ahead at first, 12 ms per second behind since.
    assert estimate.offset_s == pytest.approx(7.0 - 0.012 * 19.5, abs=0.002)


@given(phase_s=st.floats(0.0, 0.004), step_s=st.sampled_from([0.004, 0.008]))
def test_a_clock_that_advances_in_steps_is_known_to(phase_s: float, step_s: float) -> None:
    clock = ClockMap(max_drift=2e-4)
    for number in range(30):
        t_s = phase_s + number * 0.4871
        _exchange(
            clock, t_s=t_s, there_s=0.001, back_s=0.001, offset_s=2.0, drift=0.0, step_s=step_s
        )
    error_s = clock.run_time(t_s + 2.0) - t_s
    assert clock.resets == 0
    assert abs(error_s) <= clock.uncertainty_s + 1e-3
    assert clock.uncertainty_s <= step_s / 2.0 + 0.0015


def test_stamps_that_contradict_each_other_widen_the_bound() -> None:
    clock = ClockMap(max_drift=2e-4)
    for number in range(20):
        offset_s = 5.0 if number % 2 else 5.01
        _exchange(
            clock, t_s=number * 0.487321, there_s=0.001, back_s=0.001, offset_s=offset_s, drift=0.0
        )
    assert clock.resets == 0
    assert 0.004 < clock.uncertainty_s < 0.008
    assert clock.run_time(15.005) == pytest.approx(10.0, abs=clock.uncertainty_s)


def test_a_restarted_clock_resets_the_mapping() -> None:
    clock = ClockMap()
    for number in range(10):
        _exchange(clock, t_s=number * 0.5, there_s=0.001, back_s=0.001, offset_s=90.0, drift=0.0)
    _exchange(clock, t_s=6.0, there_s=0.001, back_s=0.001, offset_s=-5.0, drift=0.0)
    assert clock.resets == 1
    assert clock.run_time(2.0) == pytest.approx(7.0, abs=0.002)


def test_a_clock_set_ahead_resets_after_three_contradictions() -> None:
    clock = ClockMap()
    for number in range(10):
        _exchange(clock, t_s=number * 0.5, there_s=0.001, back_s=0.001, offset_s=1.0, drift=0.0)
    for number in range(10, 13):
        assert clock.resets == 0
        _exchange(clock, t_s=number * 0.5, there_s=0.001, back_s=0.001, offset_s=4.0, drift=0.0)
    assert clock.resets == 1
    assert clock.run_time(10.0) == pytest.approx(6.0, abs=0.002)


def test_a_single_wild_stamp_changes_nothing() -> None:
    clock = ClockMap()
    for number in range(20):
        offset_s = 9.0 if number == 10 else 1.0
        _exchange(
            clock, t_s=number * 0.5, there_s=0.001, back_s=0.001, offset_s=offset_s, drift=0.0
        )
    assert clock.resets == 0
    assert clock.run_time(10.5) == pytest.approx(9.5, abs=0.002)


def test_nonsense_is_refused() -> None:
    clock = ClockMap()
    with pytest.raises(ValueError, match="no TIMESYNC"):
        clock.run_time(1.0)
    with pytest.raises(ValueError, match="no TIMESYNC"):
        clock.estimate()
    with pytest.raises(ValueError, match="answered"):
        clock.add(t_sent_s=2.0, t_received_s=1.0, remote_ns=5)


class _Vehicle:
    """Answers TIMESYNC and stamps telemetry, with an epoch of its own for each."""

    def __init__(
        self, *, boot_offset_s: float, epoch_s: float = 0.0, latency_s: float = 0.01
    ) -> None:
        self.clock = VehicleClock(own_id=245)
        self.boot_offset_s = boot_offset_s
        self.epoch_s = epoch_s
        self.latency_s = latency_s

    def sync(self, t_s: float) -> bool:
        stamp = self.clock.ask(t_s)
        remote_s = t_s + self.latency_s + self.boot_offset_s + self.epoch_s
        return self.clock.answered(
            tc1=round(remote_s * 1e9), ts1=stamp, arrived_s=t_s + 2 * self.latency_s
        )

    def stamp(self, t_s: float) -> float:
        return self.clock.stamped(t_s + self.boot_offset_s, t_s + self.latency_s)


def test_telemetry_is_mapped_by_timesync() -> None:
    vehicle = _Vehicle(boot_offset_s=500.0)
    for number in range(20):
        t_s = number * 0.0937123
        assert vehicle.sync(t_s)
        assert vehicle.stamp(t_s) == pytest.approx(t_s, abs=0.001)
    assert vehicle.clock.boot_time(3.0) == pytest.approx(503.0, abs=0.001)
    assert vehicle.clock.uncertainty_s is not None
    assert vehicle.clock.uncertainty_s < 0.011


def test_before_timesync_the_least_delay_stands_in() -> None:
    vehicle = _Vehicle(boot_offset_s=500.0)
    with pytest.raises(ValueError, match="neither"):
        vehicle.clock.run_time(1.0)
    assert vehicle.clock.boot_time(1.0) == 0.0
    for number in range(10):
        t_s = number * 0.1
        assert t_s <= vehicle.stamp(t_s) <= t_s + 0.0101
    assert not vehicle.clock.synchronised
    assert vehicle.clock.uncertainty_s is None
    assert vehicle.clock.estimate() is None


@pytest.mark.parametrize("epoch_s", [1.7e9, 3600.0, -400.0])
def test_another_epoch_of_timesync_is_found_by_arrivals(epoch_s: float) -> None:
    vehicle = _Vehicle(boot_offset_s=500.0, epoch_s=epoch_s)
    for number in range(20):
        t_s = 1.0 + number * 0.0937123
        vehicle.sync(t_s)
        mapped_s = vehicle.stamp(t_s)
    assert mapped_s == pytest.approx(t_s, abs=0.002)
    assert vehicle.clock.boot_time(9.0) == pytest.approx(509.0, abs=0.002)


def test_a_stamp_never_lies_after_its_arrival() -> None:
    clock = VehicleClock()
    stamp = clock.ask(0.0)
    assert clock.answered(tc1=5_000_000_001, ts1=stamp, arrived_s=0.2)
    assert clock.stamped(5.15, 0.1) <= 0.1


def test_foreign_answers_and_questions_are_ignored() -> None:
    clock = VehicleClock()
    stamp = clock.ask(1.0)
    assert not clock.answered(tc1=0, ts1=stamp, arrived_s=1.1)
    assert not clock.answered(tc1=77, ts1=stamp + 1, arrived_s=1.1)
    assert clock.answered(tc1=77_000_001, ts1=stamp, arrived_s=1.1)
    assert not clock.answered(tc1=77_000_001, ts1=stamp, arrived_s=1.2)


def test_requests_are_distinguished_by_who_asked() -> None:
    assert VehicleClock(own_id=245).ask(1.0) != VehicleClock(own_id=255).ask(1.0)
    assert VehicleClock().ask(0.0) > 0


def test_a_reboot_is_noticed_by_its_stamps() -> None:
    vehicle = _Vehicle(boot_offset_s=500.0)
    for number in range(20):
        vehicle.sync(number * 0.0937123)
        vehicle.stamp(number * 0.0937123)
    vehicle.boot_offset_s = -1.0
    vehicle.stamp(2.5)
    assert vehicle.clock.reboots == 1
    vehicle.sync(2.6)
    assert vehicle.stamp(2.7) == pytest.approx(2.7, abs=0.002)


def test_an_answer_that_seems_to_be_older_than_its_question_tells_nothing() -> None:
    # Another process stamps arrivals; under the scaled clock its time may be a little behind ours.
    clock = VehicleClock()
    asked = clock.ask(10.0)
    assert clock.answered(tc1=5_000_000_000, ts1=asked, arrived_s=9.9)
    assert not clock.synchronised
    asked = clock.ask(11.0)
    assert clock.answered(tc1=6_000_000_000, ts1=asked, arrived_s=11.1)
    assert clock.synchronised
