"""The simulated impairments of a radio link: settings, and when each frame arrives; pure."""

import heapq
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

_DRAWS = 7
"""Random numbers per frame, drawn for every frame: a setting does not shift the others' draws."""
_BLOCK = 256


@dataclass(frozen=True, slots=True, kw_only=True)
class BurstLoss:
    """An impairment: loss in bursts, by the two-state model of Gilbert and Elliott.

    The state changes with time, not with each frame, so that a burst is as long in both directions
    whatever they carry: length_s and gap_s are the mean lengths of bursts and of the times between,
    both exponential. loss_within, loss_between: the probabilities of loss then.
    E. N. Gilbert, "Capacity of a burst-noise channel" (1960); E. O. Elliott (1963).
    """

    length_s: float
    gap_s: float
    loss_within: float = 1.0
    loss_between: float = 0.0

    def __post_init__(self) -> None:
        for name in ("loss_within", "loss_between"):
            _check_chance(name, getattr(self, name))
        for name in ("length_s", "gap_s"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name} is {getattr(self, name)}: it is a mean time above 0 s")

    def chance_within(self, *, was_within: bool, elapsed_s: float) -> float:
        """Return the probability of being in a burst elapsed_s after a known state."""
        share = self.length_s / (self.length_s + self.gap_s)
        forgotten = math.exp(-elapsed_s * (1.0 / self.length_s + 1.0 / self.gap_s))
        return share + ((1.0 if was_within else 0.0) - share) * forgotten


@dataclass(frozen=True, slots=True)
class LinkOutage:
    """An impairment: an outage, seconds after the link was opened, and for how long."""

    from_s: float
    duration_s: float

    def __post_init__(self) -> None:
        if not (0.0 <= self.from_s < math.inf and 0.0 < self.duration_s < math.inf):
            raise ValueError(
                f"a blackout from {self.from_s} s for {self.duration_s} s: both must be finite, "
                "the start 0 or more and the duration positive"
            )

    def covers(self, t_s: float) -> bool:
        """Return whether the outage covers a moment."""
        return self.from_s <= t_s < self.from_s + self.duration_s


@dataclass(frozen=True, slots=True, kw_only=True)
class Impairment:
    """The impairment of one direction of a link, per MAVLink frame; the default does nothing.

    latency_s, jitter_s: a frame takes latency_s, more or less by up to jitter_s, uniformly
    distributed; frames keep their order, as on a radio. loss, duplicate, reorder, corrupt:
    probabilities per frame. A reordered frame is late by reorder_by_s and overtaken by those after
    it. A corrupted one has one bit flipped. bandwidth_bit_s: frames queue for it; a frame that
    would wait longer than queue_s is lost. outages: times in which all frames are lost. Raises
    ValueError for impossible values.
    """

    latency_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0
    bursts: BurstLoss | None = None
    duplicate: float = 0.0
    reorder: float = 0.0
    reorder_by_s: float = 0.05
    corrupt: float = 0.0
    bandwidth_bit_s: float | None = None
    queue_s: float = 1.0
    outages: tuple[LinkOutage, ...] = ()

    def __post_init__(self) -> None:
        for name in ("loss", "duplicate", "reorder", "corrupt"):
            _check_chance(name, getattr(self, name))
        for name in ("latency_s", "jitter_s", "reorder_by_s", "queue_s"):
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise ValueError(f"{name} is {value}: it is a time of 0 s or more")
        if self.jitter_s > self.latency_s:
            raise ValueError(
                f"jitter_s is {self.jitter_s} and latency_s {self.latency_s}: a frame would arrive "
                "before it was sent; make jitter_s at most latency_s"
            )
        if self.bandwidth_bit_s is not None and not 0.0 < self.bandwidth_bit_s < math.inf:
            raise ValueError(
                f"bandwidth_bit_s is {self.bandwidth_bit_s}: it must be positive; leave it out for "
                "no limit"
            )


@dataclass(slots=True)
class ImpairmentCounts:
    """The counts of frames by outcome in an impaired direction."""

    frames: int = 0
    lost: int = 0
    lost_in_outage: int = 0
    overflowed: int = 0
    duplicated: int = 0
    reordered: int = 0
    corrupted: int = 0
    delivered: int = 0


class ImpairedDirection:
    """One direction under impairment: takes frames, returns them when they arrive.

    Times are seconds of any one clock; outages count from `opened_s`.
    """

    def __init__(
        self, *, impairment: Impairment, rng: np.random.Generator, opened_s: float
    ) -> None:
        self._settings = impairment
        self._draws = _uniforms(rng)
        self._opened_s = opened_s
        self._queue: list[tuple[float, int, bytes]] = []
        self._number = 0
        self._busy_until_s = -math.inf
        self._last_due_s = -math.inf
        self._in_burst = False
        self._burst_known_s = opened_s
        self._forced_until_s = -math.inf
        self.counts = ImpairmentCounts()

    def start_outage(self, now_s: float, duration_s: float) -> None:
        """Start an outage of this direction for a while."""
        self._forced_until_s = max(self._forced_until_s, now_s + duration_s)

    def put(self, frame: bytes, now_s: float) -> None:
        """Take one frame that is sent now into the impairment."""
        settings, counts = self._settings, self.counts
        lost, state, burst, delay, copy, order, corrupt = next(self._draws)
        counts.frames += 1
        sent_s = self._through_bottleneck(len(frame), now_s)
        if sent_s is None:
            counts.overflowed += 1
            return
        if self._is_in_outage(now_s):
            counts.lost_in_outage += 1
            return
        if self._lost_in_burst(state, burst, now_s) or lost < settings.loss:
            counts.lost += 1
            return
        if corrupt < settings.corrupt:
            counts.corrupted += 1
            # The rest of the random number chooses the bit.
            frame = _with_bit_flipped(frame, corrupt / settings.corrupt)
        due_s = sent_s + settings.latency_s + (2.0 * delay - 1.0) * settings.jitter_s
        if order < settings.reorder:
            counts.reordered += 1
            due_s += settings.reorder_by_s
        else:
            due_s = self._last_due_s = max(due_s, self._last_due_s)
        self._push(due_s, frame)
        if copy < settings.duplicate:
            counts.duplicated += 1
            self._push(due_s, frame)

    @property
    def next_due_s(self) -> float | None:
        """Return when the next impaired frame arrives; None without."""
        return self._queue[0][0] if self._queue else None

    def take(self, now_s: float) -> list[bytes]:
        """Return the frames that arrive by now through the impairment, in order."""
        arrived = []
        while self._queue and self._queue[0][0] <= now_s:
            due_s, _, frame = heapq.heappop(self._queue)
            # A frame that would arrive during an outage is lost too.
            if self._is_in_outage(due_s):
                self.counts.lost_in_outage += 1
            else:
                arrived.append(frame)
        self.counts.delivered += len(arrived)
        return arrived

    def _push(self, due_s: float, frame: bytes) -> None:
        self._number += 1
        heapq.heappush(self._queue, (due_s, self._number, frame))

    def _is_in_outage(self, t_s: float) -> bool:
        if t_s < self._forced_until_s:
            return True
        since_s = t_s - self._opened_s
        return any(outage.covers(since_s) for outage in self._settings.outages)

    def _through_bottleneck(self, size: int, now_s: float) -> float | None:
        """Return when a frame leaves the bottleneck; None when its queue is full."""
        rate = self._settings.bandwidth_bit_s
        if rate is None:
            return now_s
        begin_s = max(now_s, self._busy_until_s)
        if begin_s - now_s > self._settings.queue_s:
            return None
        self._busy_until_s = begin_s + 8.0 * size / rate
        return self._busy_until_s

    def _lost_in_burst(self, state: float, draw: float, now_s: float) -> bool:
        bursts = self._settings.bursts
        if bursts is None:
            return False
        elapsed_s, self._burst_known_s = now_s - self._burst_known_s, now_s
        chance = bursts.chance_within(was_within=self._in_burst, elapsed_s=elapsed_s)
        self._in_burst = state < chance
        return draw < (bursts.loss_within if self._in_burst else bursts.loss_between)


def _uniforms(rng: np.random.Generator) -> Iterator[tuple[float, ...]]:
    """Yield the random numbers that the impairment draws per frame."""
    while True:
        yield from map(tuple, rng.random((_BLOCK, _DRAWS)).tolist())


def _with_bit_flipped(frame: bytes, where: float) -> bytes:
    """Return an impaired frame with one bit flipped."""
    bit = min(int(where * 8 * len(frame)), 8 * len(frame) - 1)
    at = bit // 8
    return frame[:at] + bytes([frame[at] ^ 1 << bit % 8]) + frame[at + 1 :]


def _check_chance(name: str, value: float) -> None:
    """Raise ValueError when an impairment's probability is not within 0 to 1."""
    if not 0.0 <= value <= 1.0:
        raise ValueError(f"{name} is {value}: it is a chance from 0 to 1")
