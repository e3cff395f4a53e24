"""Controls the scaled run clock so that it follows a simulation's own time; pure.

A simulator with a requested ten times real time may attain seven, and another figure a moment
later. Its `time_boot_ms` shows its time. The run clock is piecewise linear over wall time: each
segment begins where the last one ends, so that the clock never goes back and never jumps, and its
slope is controlled towards the simulator's time.
"""

import math
from collections import deque
from dataclasses import dataclass

STEP_S = 0.05
"""The wall time from one segment to the next."""
STALL_S = 5.0
"""A simulator whose time does not advance for so much wall time hangs."""
APART_S = 1.0
"""Clocks that differ by more do not belong to one flight."""

_WINDOW_S = 1.0
_SAMPLE_S = 0.02
_ENOUGH_S = 0.3
_AHEAD_S = (0.06, 0.3)
"""Without stamps of the simulation its time is extrapolated for so much wall time: three times the
interval between its stamps, within these limits."""
_AHEAD_INTERVALS = 3.0
_SETTLING_S = 0.5
"""Time constant with which a difference is made up."""
_SLEW = 4.0
"""By how many times the nominal pace the slope may change within a second."""
_FASTEST = 2.0
_STEPS_TO_STALL = round(STALL_S / STEP_S / 2)
"""So many own steps must have been made meanwhile: a suspended machine has stalled no simulator."""
_REBOOT_S = 1.0
_OVERTAKEN_S = 0.1
"""A stamp that is older than the newest by more is of a reboot: `_REBOOT_S`, or what the fastest
simulation makes in so much wall time, in which a packet may overtake another."""
_BASE_S = 2.0
_LASTS_S = 1.0


@dataclass(frozen=True, slots=True)
class ClockSegment:
    """A linear segment of the sim clock: `run_s` at `wall_s` (CLOCK_MONOTONIC), and a slope.

    rate: run seconds per wall second, 0 or more. holds_s: after so much wall time the clock stops
    until the next segment arrives; infinite where it continues.
    """

    wall_s: float
    run_s: float
    rate: float
    holds_s: float = math.inf

    @property
    def end_s(self) -> float:
        """Return the sim clock's time at which it stops; infinite where it continues."""
        return self.run_s + self.holds_s * self.rate if self.holds_s < math.inf else math.inf

    def at(self, wall_s: float) -> float:
        """Return the sim clock's time at a wall time."""
        return self.run_s + max(0.0, min(wall_s - self.wall_s, self.holds_s)) * self.rate


class BootTrack:
    """Tracks a simulated vehicle's time since boot against the wall, from late stamps.

    Of several stamps within a few milliseconds the last one counts: buffered ones arrive together.
    nominal: the requested pace.
    """

    def __init__(self, *, nominal: float) -> None:
        self._reboot_s = max(_REBOOT_S, _OVERTAKEN_S * _FASTEST * nominal)
        self._samples: deque[tuple[float, float]] = deque()
        self._began_s = -math.inf
        self._advanced_s: float | None = None
        self.first_s: float | None = None
        self.reboots = 0

    @property
    def known(self) -> bool:
        """Return whether the simulation's rate is known."""
        samples = self._samples
        return len(samples) > 2 and samples[-1][0] - samples[0][0] >= _ENOUGH_S

    @property
    def newest_s(self) -> float:
        """Return the simulation's newest stamp. Raises IndexError before the first."""
        return self._samples[-1][1]

    @property
    def ahead_s(self) -> float:
        """Return how long the simulation's time may be extrapolated."""
        samples = self._samples
        if len(samples) < 2:
            return _AHEAD_S[1]
        between_s = (samples[-1][0] - samples[0][0]) / (len(samples) - 1)
        return min(max(_AHEAD_INTERVALS * between_s, _AHEAD_S[0]), _AHEAD_S[1])

    def still_s(self, wall_s: float) -> float:
        """Return for how much wall time the simulation's clock has not advanced."""
        return 0.0 if self._advanced_s is None else wall_s - self._advanced_s

    def received(self, wall_s: float, boot_s: float) -> None:
        """Take a simulation's stamp that arrived at a wall time."""
        if self._samples and boot_s < self._samples[-1][1] - self._reboot_s:
            self._samples.clear()
            self._began_s, self.first_s = -math.inf, None
            self.reboots += 1
        if self._samples and boot_s <= self._samples[-1][1]:
            return
        if self.first_s is None:
            self.first_s = wall_s
        self._advanced_s = wall_s
        if wall_s - self._began_s < _SAMPLE_S:
            self._samples[-1] = (wall_s, boot_s)
        else:
            self._began_s = wall_s
            self._samples.append((wall_s, boot_s))
        while wall_s - self._samples[0][0] > _WINDOW_S:
            self._samples.popleft()

    def line(self, wall_s: float) -> tuple[float, float]:
        """Return the simulation's time at a wall time, and its rate, by least squares."""
        count = len(self._samples)
        mean_w = sum(w for w, _ in self._samples) / count
        mean_b = sum(b for _, b in self._samples) / count
        spread = sum((w - mean_w) ** 2 for w, _ in self._samples)
        rate = sum((w - mean_w) * (b - mean_b) for w, b in self._samples) / spread
        return mean_b + (wall_s - mean_w) * rate, rate


class SimClockController:
    """Controls the run clock so that it follows the leading simulation.

    nominal: the requested pace. Until `begin` it is the wall clock.
    """

    def __init__(self, *, nominal: float) -> None:
        self._nominal = nominal
        self._segment = ClockSegment(0.0, 0.0, 1.0)
        self._offset_s: float | None = None
        self._reboots = 0
        self._steps_still = 0
        self._cruise = nominal
        self.stalled = False
        self.track = BootTrack(nominal=nominal)

    @property
    def segment(self) -> ClockSegment:
        """Return the controlled clock's present segment."""
        return self._segment

    @property
    def locked(self) -> bool:
        """Return whether the clock has locked to the simulation."""
        return self._offset_s is not None

    def begin(self, segment: ClockSegment) -> None:
        """Start the controlled clock from a segment."""
        self._segment = segment

    def step(self, wall_s: float) -> ClockSegment:
        """Return the controlled clock's next segment; called every `STEP_S` wall time."""
        last = self._segment
        run_s, dt_s = last.at(wall_s), max(0.0, wall_s - last.wall_s)
        wanted = min(max(self._wanted_rate(wall_s, run_s), 0.0), _FASTEST * self._nominal)
        most = _SLEW * self._nominal * min(dt_s, 2.0 * STEP_S)
        # A quiet simulation may hang: the clock may stop at once, so that no time limit runs out.
        least = 0.0 if self._quiet(wall_s) else last.rate - most
        rate = min(max(wanted, least), last.rate + most)
        self._segment = ClockSegment(wall_s, run_s, rate)
        return self._segment

    def _quiet(self, wall_s: float) -> bool:
        return self.locked and not self.stalled and self.track.still_s(wall_s) > self.track.ahead_s

    def _wanted_rate(self, wall_s: float, run_s: float) -> float:
        track = self.track
        if track.reboots != self._reboots:
            self._reboots, self._offset_s = track.reboots, None
        if self.stalled:
            return self._cruise
        still_s = track.still_s(wall_s)
        self._steps_still = self._steps_still + 1 if still_s > STEP_S else 0
        if still_s > STALL_S and self._steps_still >= _STEPS_TO_STALL:
            self.stalled = True
            return self._cruise
        if not track.known and self._offset_s is None:
            return self._segment.rate
        if track.known:
            boot_s, rate = track.line(wall_s)
        else:
            boot_s, rate = track.newest_s + still_s * self._cruise, self._cruise
        if self._offset_s is None:
            self._offset_s = run_s - boot_s
        quiet, ahead_s = self._quiet(wall_s), track.ahead_s
        if not quiet:
            self._cruise = min(max(rate, 0.1), _FASTEST * self._nominal)
        target_s = self._offset_s + min(boot_s, track.newest_s + ahead_s * self._cruise)
        return (0.0 if quiet else rate) + (target_s - run_s) / _SETTLING_S


class ClockDivergence:
    """Detects that a simulated vehicle's time diverges from the run clock.

    Its offset counts from a moment after both were known; one that is made up within a second is
    ignored.
    """

    def __init__(self) -> None:
        self._base_s: float | None = None
        self._since_s: float | None = None
        self._apart_from_s: float | None = None
        self._reboots = 0
        self.off_s = 0.0

    def look(self, track: BootTrack, *, wall_s: float, run_s: float) -> bool:
        """Return whether the sim time has diverged by more than `APART_S` for good."""
        if track.reboots != self._reboots or not track.known:
            self._reboots = track.reboots
            self._base_s = self._since_s = self._apart_from_s = None
            return False
        if self._since_s is None:
            self._since_s = wall_s
        if wall_s - self._since_s < _BASE_S:
            return False
        # Without new stamps the vehicle's time is extrapolated for a short while only.
        boot_s, rate = track.line(wall_s)
        boot_s = min(boot_s, track.newest_s + track.ahead_s * rate)
        if self._base_s is None:
            self._base_s = boot_s - run_s
        self.off_s = boot_s - run_s - self._base_s
        if abs(self.off_s) <= APART_S:
            self._apart_from_s = None
        elif self._apart_from_s is None:
            self._apart_from_s = wall_s
        return self._apart_from_s is not None and wall_s - self._apart_from_s >= _LASTS_S
