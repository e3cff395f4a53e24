"""Detects when and where a body has passed the plane of a gate as a whole; pure."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.safety.oracles.oracle_context import GateOpening
from wil_campaign.worlds.frames import Vec3, add, norm, rotate

Side = Literal[1, -1]


@dataclass(frozen=True, slots=True)
class GatePassage:
    """A passage: the whole body went from one side of a gate's plane to the other.

    direction: +1 along the gate's forward axis. offset_m: distance of the body's centre from the
    opening's centre when it crossed the plane, at_s. reach_m: the largest offset of any point of
    the body.
    """

    direction: Side
    offset_m: float
    reach_m: float
    at_s: float


@dataclass(frozen=True, slots=True)
class GateDip:
    """A dip into a gate: the centre crossed the plane and came back before the body was through.

    depth_m: how far the centre was beyond the plane; at_s: when the body was back.
    """

    depth_m: float
    at_s: float


class PassingBody:
    """The body of a passing vehicle: a box. half_m: forward, right and down from the centre."""

    def __init__(self, half_m: Vec3) -> None:
        ahead, right, down = half_m
        signs = itertools.product((-1.0, 1.0), repeat=3)
        corners = ((a * ahead, b * right, c * down) for a, b, c in signs)
        self._corners_m = tuple(dict.fromkeys(corners))
        self.radius_m = norm(half_m)

    def corners_m(self, sample: PoseSample) -> tuple[Vec3, ...]:
        """Return the passing body's corners at a pose, in NED metres."""
        q_wxyz, centre = sample.pose.q_wxyz, sample.pose.position_ned_m
        return tuple(add(centre, rotate(q_wxyz, corner)) for corner in self._corners_m)


class PassageDetector:
    """Detects passages of one body through one gate, pose by pose.

    `side` is the side on which the body last was, at least its radius away; at first, the
    side of its centre. A crossing counts only once the body is clear on the other side: a nose that
    goes in and comes back is no passage in either direction.
    """

    def __init__(
        self, gate: GateOpening, body: PassingBody, first: PoseSample, events: Mapping[str, float]
    ) -> None:
        self._gate, self._body, self._events = gate, body, events
        depth_m = self._depth_m(first)
        self.side: Side = 1 if depth_m > 0.0 else -1
        self._centre: tuple[float, float] | None = None
        self._reach_m = 0.0
        self._deepest_m = 0.0
        self._last, self._last_depth_m = first, depth_m

    @property
    def unfinished_m(self) -> float:
        """Return the centre's depth beyond the plane in an unfinished passage; else 0."""
        now = 1 if self._last_depth_m > 0.0 else -1
        return abs(self._last_depth_m) if now != self.side else 0.0

    def observe(self, sample: PoseSample) -> GatePassage | GateDip | None:
        """Take a pose; return the passage or dip that ends with it, if any."""
        last, before_m = self._last, self._last_depth_m
        depth_m = self._depth_m(sample)
        self._last, self._last_depth_m = sample, depth_m
        radius_m = self._body.radius_m
        crossed = (before_m > 0.0) != (depth_m > 0.0)
        if crossed or min(abs(before_m), abs(depth_m)) < radius_m:
            self._measure(last, sample)
        now: Side = 1 if depth_m > 0.0 else -1
        if now != self.side:
            self._deepest_m = max(self._deepest_m, abs(depth_m))
        if abs(depth_m) < radius_m:
            return None
        return self._settle(now, sample.t_s)

    def _settle(self, now: Side, t_s: float) -> GatePassage | GateDip | None:
        """Return the passage or dip of a body that is clear of the gate's plane."""
        centre, reach_m, deepest_m = self._centre, self._reach_m, self._deepest_m
        before, self.side = self.side, now
        self._centre, self._reach_m, self._deepest_m = None, 0.0, 0.0
        if now != before and centre is not None:
            return GatePassage(now, centre[0], max(reach_m, centre[0]), centre[1])
        return GateDip(deepest_m, t_s) if now == before and deepest_m > 0.0 else None

    def _measure(self, last: PoseSample, sample: PoseSample) -> None:
        """Record where centre and corners cross the gate's plane between two poses."""
        gate, events = self._gate, self._events
        t_0, t_1 = last.t_s, sample.t_s
        from_m, to_m = last.pose.position_ned_m, sample.pose.position_ned_m
        if (centre := gate.crossing(from_m, t_0, to_m, t_1, events)) is not None:
            self._centre = (centre.offset_m, t_0 + (t_1 - t_0) * centre.fraction)
            self._reach_m = max(self._reach_m, centre.offset_m)
        corners = zip(self._body.corners_m(last), self._body.corners_m(sample), strict=True)
        for corner_0, corner_1 in corners:
            crossing = gate.crossing(corner_0, t_0, corner_1, t_1, events)
            if crossing is not None:
                self._reach_m = max(self._reach_m, crossing.offset_m)

    def _depth_m(self, sample: PoseSample) -> float:
        return self._gate.depth_m(sample.pose.position_ned_m, sample.t_s, self._events)
