"""Maps a vehicle's clock to the run clock by TIMESYNC; pure.

The reply to a request of t0 that arrived at t1 was stamped somewhere in between, whatever the
latency of either direction: so each exchange bounds the offset from both sides, the closer the
shorter its round trip. All bounds of the last seconds are intersected, each widened with its age by
the uncertainty of the drift: a minimum filter of both directions at once (the idea of RFC 5905,
11.2, and of Marzullo's intersection). The bound that remains is the uncertainty.

MAVLink: a TIMESYNC request has tc1 = 0 and our time in ts1; the reply has the vehicle's time in
tc1 and ours in ts1. PX4 and ArduPilot reply with nanoseconds since boot, the epoch of time_boot_ms;
where an autopilot's epochs differ, arrival times show by how much. A simulated autopilot's clock
advances by whole steps (4 ms in PX4's): its stamps are that much too old at most, which the
greatest common divisor of the stamps shows.
"""

import math
from collections import deque
from dataclasses import dataclass

from wil_campaign.vehicles.clocks.steady_pace import SteadyPace, TimesyncExchange

_OFFSET_WINDOW_S = 5.0
_JUMP_S = 0.05
"""An exchange that contradicts the mapping by more is a jump of the vehicle's clock..."""
_CONTRADICTIONS_TO_RESET = 3
"""... once so many in succession contradict it."""
_LONGEST_STEP_NS = 20_000_000
_SHORTEST_STEP_NS = 500_000
"""Common divisors below this are the resolution of a running clock."""
_STAMPS_TO_TELL_STEPS = 4
"""Fewer stamps may have a large common divisor by chance."""
_EXCHANGES_OF_A_PACE = 3
"""So many that fit another pace than those before them show that the clock's pace has changed."""
_SHORTEST_DRIFT_SPAN_S = 0.5
_EARLY_SLACK_S = 0.05
"""Telemetry that seems to arrive before its stamp by more than this..."""
_LATEST_PLAUSIBLE_S = 1.0
"""... or after it by more than this has another epoch."""
_SLEW = 0.2
"""By how much the mapped clock may be faster or slower while a correction is slewed..."""
_LONGEST_SLEW_S = 0.25
"""... which is not larger than this: beyond, the vehicle's clock was set, or stopped for long."""
_ROUND_S = 2**32 * 1e-3
"""A time_boot_ms begins anew at 0 after so long, 49.7 days..."""
_NEAR_S = 60.0
"""... which shows while the vehicle is heard at least so often; else its clock restarted."""


@dataclass(frozen=True, slots=True)
class ClockEstimate:
    """The estimate by TIMESYNC of how a vehicle's clock relates to the run clock.

    offset_s: vehicle minus run clock, at the newest exchange. drift_ppm: how much faster the
    vehicle's clock runs. uncertainty_s: bound of the offset's error. resets: how often the
    vehicle's clock jumped.
    """

    offset_s: float
    drift_ppm: float
    uncertainty_s: float
    exchanges: int
    resets: int


class ClockMap:
    """Maps a vehicle's clock to the run clock from TIMESYNC exchanges, however asymmetric.

    max_drift bounds how far apart the rates of the clocks can be: crystals differ by 1e-4,
    simulators that claim real time by a hundredth. While that and a steady drift hold, the error
    of `run_time` is within `uncertainty_s`.
    """

    def __init__(self, *, window_s: float = 20.0, max_drift: float = 0.02) -> None:
        self._window_s = window_s
        self._max_drift = max_drift
        self._exchanges: deque[TimesyncExchange] = deque()
        self._pace = SteadyPace()
        self._step_ns = 0
        self._rate = 1.0
        self._run_s = 0.0
        self._remote_s = 0.0
        self._uncertainty_s = math.inf
        self._half_round_trip_s = 0.0
        self._contradictions = 0
        self._count = 0
        self.resets = 0
        self.began_s = -math.inf
        """When the present pace began: earlier arrivals are of no use for this mapping."""
        self.unsteady = False

    @property
    def known(self) -> bool:
        """Return whether there was any TIMESYNC exchange."""
        return bool(self._exchanges)

    @property
    def contradicted(self) -> bool:
        """Return whether the newest TIMESYNC exchange says that the clock has jumped."""
        return self._contradictions > 0

    @property
    def uncertainty_s(self) -> float:
        """Return the bound of `run_time`'s error by TIMESYNC; infinite when unknown."""
        return self._uncertainty_s

    def add(self, *, t_sent_s: float, t_received_s: float, remote_ns: int) -> None:
        """Add a TIMESYNC exchange: sent and received (run clock), and the vehicle's time.

        Raises ValueError when the reply arrived before the request was sent.
        """
        if not t_received_s >= t_sent_s:
            raise ValueError(
                f"the TIMESYNC reply of {t_received_s} s is before its request of {t_sent_s} s"
            )
        new = TimesyncExchange(t_sent_s, t_received_s, remote_ns)
        if self._has_jumped(new):
            self._exchanges.clear()
            self._pace = SteadyPace()
            self._step_ns = 0
            self._contradictions = 0
            self.resets += 1
            self.began_s = new.sent_s
        elif self._contradictions:
            return
        self._count += 1
        self._step_ns = math.gcd(self._step_ns, remote_ns)
        self._exchanges.append(new)
        while new.sent_s - self._exchanges[0].sent_s > self._window_s:
            self._exchanges.popleft()
        self._refit()

    def run_time(self, remote_s: float) -> float:
        """Return the run clock's time of a moment on the vehicle's clock, by TIMESYNC.

        Raises ValueError before the first exchange.
        """
        self._check_known()
        return self._run_s + (remote_s - self._remote_s) * self._rate

    def remote_time(self, t_s: float) -> float:
        """Return the vehicle's time at a moment of the run clock; inverse of `run_time`."""
        self._check_known()
        return self._remote_s + (t_s - self._run_s) / self._rate

    def doubt_s(self, remote_s: float) -> float:
        """Return the bound of `run_time`'s error at a vehicle's time, long after TIMESYNC too."""
        unasked_s = remote_s - self._remote_s - _OFFSET_WINDOW_S
        return self._uncertainty_s + self._max_drift * max(0.0, unasked_s)

    @property
    def half_round_trip_s(self) -> float:
        """Return half the shortest TIMESYNC round trip of the window."""
        return self._half_round_trip_s

    def estimate(self) -> ClockEstimate:
        """Return the clock estimate. Raises ValueError before the first TIMESYNC."""
        self._check_known()
        return ClockEstimate(
            offset_s=self._remote_s - self._run_s,
            drift_ppm=(1.0 / self._rate - 1.0) * 1e6,
            uncertainty_s=self._uncertainty_s,
            exchanges=self._count,
            resets=self.resets,
        )

    def _check_known(self) -> None:
        """Raise ValueError before the first TIMESYNC exchange."""
        if not self._exchanges:
            raise ValueError("the vehicle has not answered TIMESYNC yet")

    def _has_jumped(self, new: TimesyncExchange) -> bool:
        """Return whether the vehicle's clock was set or restarted since the last TIMESYNC."""
        if not self._exchanges:
            return False
        last = self._exchanges[-1]
        if new.sent_s > last.received_s and new.remote_ns < last.remote_ns:
            return True
        apart_s = abs(self.run_time(new.remote_s) - new.middle_s)
        agreed_s = new.round_trip_s / 2.0 + self._uncertainty_s + _JUMP_S
        self._contradictions = self._contradictions + 1 if apart_s > agreed_s else 0
        return self._contradictions >= _CONTRADICTIONS_TO_RESET

    def _step_s(self) -> float:
        """Return by how much stamps may be too old: the steps of the vehicle's clock."""
        if self._step_ns < _SHORTEST_STEP_NS or len(self._exchanges) < _STAMPS_TO_TELL_STEPS:
            return 0.0
        return min(self._step_ns, _LONGEST_STEP_NS) * 1e-9

    def _refit(self) -> None:
        """Refit the clock map: intersect the bounds of all TIMESYNC exchanges."""
        step_s = self._step_s()
        began_s, steady = self.began_s, self._pace.steady(self._exchanges, step_s)
        if steady >= _EXCHANGES_OF_A_PACE:
            while len(self._exchanges) > steady:
                self._exchanges.popleft()
                self.began_s = self._exchanges[0].sent_s
        self._rate, rate_error = self._fitted_rate(step_s)
        self._half_round_trip_s = min(map(_round_trip, self._exchanges)) / 2.0
        newest = self._exchanges[-1]
        at_s = newest.remote_s
        low, high = -math.inf, math.inf
        for each in reversed(self._exchanges):
            if newest.sent_s - each.sent_s > _OFFSET_WINDOW_S:
                break
            age_s = at_s - each.remote_s
            moved_s, blur_s = age_s * self._rate, abs(age_s) * rate_error
            low = max(low, each.sent_s - step_s + moved_s - blur_s)
            high = min(high, each.received_s + moved_s + blur_s)
        self._remote_s = at_s
        self._run_s = (low + high) / 2.0
        self._uncertainty_s = (high - low) / 2.0
        self.unsteady = low > high or self.began_s != began_s or self.resets > 0
        if low > high:
            # The clock is not steady, or its stamps are late: by this much at least.
            self._uncertainty_s = self._half_round_trip_s + (low - high) / 2.0

    def _fitted_rate(self, step_s: float) -> tuple[float, float]:
        """Return run seconds per vehicle second by TIMESYNC, and the bound of its error."""
        first, last = self._exchanges[0].remote_s, self._exchanges[-1].remote_s
        if last - first < _SHORTEST_DRIFT_SPAN_S:
            return 1.0, self._max_drift
        third = (last - first) / 3.0
        early = (each for each in self._exchanges if each.remote_s <= first + third)
        late = (each for each in self._exchanges if each.remote_s >= last - third)
        old, new = min(early, key=_round_trip), min(late, key=_round_trip)
        span_s = new.remote_s - old.remote_s
        rate = (new.middle_s - old.middle_s) / span_s
        error = ((old.round_trip_s + new.round_trip_s) / 2.0 + step_s) / span_s
        low = max(rate - error, 1.0 - self._max_drift)
        high = min(rate + error, 1.0 + self._max_drift)
        if low > high:
            # Beyond max_drift: use the measured rate.
            return rate, error
        return (low + high) / 2.0, (high - low) / 2.0


def _round_trip(exchange: TimesyncExchange) -> float:
    return exchange.round_trip_s


_INVERSIONS = 3
"""Each leaves a fifth of the error of the last."""


class _LeastDelay:
    """The least telemetry delay of the last `span_s` to twice that."""

    def __init__(self, span_s: float) -> None:
        self._span_s = span_s
        self._since_s = -math.inf
        self._current = math.inf
        self._previous = math.inf

    def add(self, value: float, now_s: float) -> None:
        if now_s - self._since_s > self._span_s:
            self._since_s, self._previous, self._current = now_s, self._current, value
        elif value < self._current:
            self._current = value

    @property
    def value(self) -> float:
        return min(self._current, self._previous)


@dataclass(frozen=True, slots=True)
class _Slew:
    """A correction of the clock map that is applied gradually, by the vehicle's time.

    left_s: by how much the mapped time is ahead of the map at `remote_s`, and before.
    """

    remote_s: float = 0.0
    left_s: float = 0.0

    def at(self, remote_s: float) -> float:
        """Return by how much the mapped time is ahead of the clock map at a vehicle's time."""
        if not self.left_s:
            return 0.0
        slewed_s = _SLEW * max(0.0, remote_s - self.remote_s)
        return math.copysign(max(0.0, abs(self.left_s) - slewed_s), self.left_s)


class VehicleClock:
    """Maps time_boot of a vehicle's telemetry to the run clock and back, by TIMESYNC.

    Feed it TIMESYNC requests and replies, and stamps of telemetry as they arrive. Before the first
    reply, and where TIMESYNC has another epoch than time_boot, the least delay of arrivals is used
    instead, and `uncertainty_s` says so.

    A simulation on a busy machine falls behind, or stops for a moment. TIMESYNC's correction is
    then slewed, not stepped: stamps that follow each other closely stay close, and in order.
    """

    def __init__(self, *, own_id: int = 0, max_drift: float = 0.02) -> None:
        self._own_id = own_id
        self._max_drift = max_drift
        self._map = ClockMap(max_drift=max_drift)
        self._slew = _Slew()
        self._sent_requests: dict[int, float] = {}
        self._raw_delay = _LeastDelay(5.0)
        self._mapped_delay = _LeastDelay(5.0)
        self._epoch_shift_s = 0.0
        self._newest_boot_s = -math.inf
        self.reboots = 0

    def ask(self, t_s: float) -> int:
        """Return the ts1 of a TIMESYNC that is sent now."""
        stamp = round(t_s * 1e9) // 1000 * 1000 + self._own_id % 1000
        # tc1 = 0 marks a request: a peer that swaps the fields would make one of a stamp of 0.
        stamp = max(stamp, 1)
        self._sent_requests[stamp] = t_s
        if len(self._sent_requests) > 32:
            del self._sent_requests[next(iter(self._sent_requests))]
        return stamp

    def answered(self, *, tc1: int, ts1: int, arrived_s: float) -> bool:
        """Take a received TIMESYNC; return whether it answers one of ours."""
        t_sent_s = self._sent_requests.pop(ts1, None) if tc1 != 0 else None
        if t_sent_s is None:
            return False
        if arrived_s < t_sent_s:
            # Another process stamped the arrival, and its scaled clock was just slowed down.
            return True
        began_s, remote_s = self._map.began_s, tc1 * 1e-9
        before_s = self._mapped(remote_s) if self._map.known else None
        self._map.add(t_sent_s=t_sent_s, t_received_s=arrived_s, remote_ns=tc1)
        if self._map.began_s != began_s:
            self._mapped_delay = _LeastDelay(5.0)
        left_s = 0.0 if before_s is None else before_s - self._map.run_time(remote_s)
        # A better estimate of a steady clock is no correction of its pace: it needs no slew.
        slews = self._map.unsteady or self._slew.at(remote_s)
        self._slew = _Slew(remote_s, left_s if slews and abs(left_s) <= _LONGEST_SLEW_S else 0.0)
        return True

    def stamped(self, boot_s: float, arrived_s: float) -> float:
        """Take an arriving telemetry stamp; return its time on the run clock.

        Never later than its arrival.
        """
        if boot_s < self._newest_boot_s - 1.0:
            self._restart()
        self._newest_boot_s = max(self._newest_boot_s, boot_s)
        self._raw_delay.add(arrived_s - boot_s, arrived_s)
        if self._map.known and not self._map.contradicted:
            self._mapped_delay.add(self._map.remote_time(arrived_s) - boot_s, arrived_s)
            self._update_epoch_shift()
        return min(self.run_time(boot_s), arrived_s)

    def since_boot(self, boot_s: float) -> float:
        """Return a stamp, which may have begun anew after 49.7 days, beside the newest one."""
        newest_s = max(0.0, self._newest_boot_s)
        if -_NEAR_S <= boot_s - newest_s <= _NEAR_S:
            return boot_s
        whole_s = boot_s + round((newest_s - boot_s) / _ROUND_S) * _ROUND_S
        return whole_s if abs(whole_s - newest_s) <= _NEAR_S else boot_s

    def run_time(self, boot_s: float) -> float:
        """Return the run clock's time of a vehicle's moment in seconds since boot.

        Raises ValueError when nothing is known of the clock.
        """
        if self._map.known:
            return self._mapped(boot_s + self._epoch_shift_s)
        if self._raw_delay.value == math.inf:
            raise ValueError("the vehicle's time is unknown: no TIMESYNC reply, no telemetry yet")
        return boot_s + self._raw_delay.value

    def boot_time(self, t_s: float) -> float:
        """Return the vehicle's seconds since boot at a run-clock time; 0 when unknown."""
        if self._map.known:
            remote_s = self._map.remote_time(t_s)
            for _ in range(_INVERSIONS):
                remote_s = self._map.remote_time(t_s - self._slew.at(remote_s))
            return remote_s - self._epoch_shift_s
        return t_s - self._raw_delay.value if self._raw_delay.value < math.inf else 0.0

    @property
    def synchronised(self) -> bool:
        """Return whether the vehicle has answered TIMESYNC."""
        return self._map.known

    @property
    def uncertainty_s(self) -> float | None:
        """Return the bound of the clock map's error; None with arrivals only.

        It grows while telemetry comes and TIMESYNC is not answered: nothing tells the pace then.
        """
        if not self._map.known:
            return None
        remote_s = self._newest_boot_s + self._epoch_shift_s
        shift_error_s = self._map.half_round_trip_s if self._epoch_shift_s else 0.0
        return self._map.doubt_s(remote_s) + shift_error_s + abs(self._slew.at(remote_s))

    def estimate(self) -> ClockEstimate | None:
        """Return the clock estimate by TIMESYNC; None with arrivals only."""
        return self._map.estimate() if self._map.known else None

    def _mapped(self, remote_s: float) -> float:
        """Return the run clock's time of the vehicle's, without a step where the map made one."""
        return self._map.run_time(remote_s) + self._slew.at(remote_s)

    def _update_epoch_shift(self) -> None:
        """Decide whether TIMESYNC and time_boot share an epoch, and their shift."""
        least_s = self._mapped_delay.value
        # A clock whose pace changes may be mapped ahead by as much as is being slewed.
        changes = self._map.began_s > -math.inf
        slack_s = _EARLY_SLACK_S + (_LONGEST_SLEW_S if changes else 0.0)
        early_s = -(self._map.uncertainty_s + slack_s)
        same_epoch = early_s <= least_s <= _LATEST_PLAUSIBLE_S
        self._epoch_shift_s = 0.0 if same_epoch else least_s - self._map.half_round_trip_s

    def _restart(self) -> None:
        self.reboots += 1
        self._newest_boot_s = -math.inf
        self._map = ClockMap(max_drift=self._max_drift)
        self._slew = _Slew()
        self._sent_requests.clear()
        self._raw_delay = _LeastDelay(5.0)
        self._mapped_delay = _LeastDelay(5.0)
        self._epoch_shift_s = 0.0
