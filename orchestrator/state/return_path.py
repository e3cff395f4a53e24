"""Whether a vehicle may fly back to its start after a run, and by which path; pure.

A vehicle flies back only after a flight that was safe for it: landed, disarmed, nothing real
touched, no intervention. Battery and estimator are checked by the preflight of the return flight.
"""

import csv
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.worlds.clearance.clearance import ClearanceProbe
from wil_campaign.worlds.frames import Pose, Vec3, norm, subtract

CLEAR_M = 0.5
"""Clearance around a vehicle on its return path, which avoids no obstacles."""
_STANDS_M = CLEAR_M + 0.1
"""From so far above its place its climb is checked: what it stands on is no obstacle."""
_STEP_M = 0.1
_UNSETTLED = frozenset({"ABORTED", "ERROR"})
"""Verdicts after which nobody knows how a vehicle was left."""
_FORBIDDING = frozenset({"failsafe", "lost", "takeover", "silence", "guard", "clock", "abort"})
"""Events of the guard after which an operator has to inspect the vehicle."""

_FAULTS = frozenset({"fault", "failsafe", "reboot"})


@dataclass(frozen=True, slots=True, kw_only=True)
class ReturnPath:
    """A return path. stand: pose of the vehicle, start: its destination; world frame.

    altitude_m: above the world's ground; speed_m_s: of the flight.
    """

    stand: Pose
    start: Pose
    altitude_m: float
    speed_m_s: float

    @property
    def points(self) -> tuple[Vec3, Vec3, Vec3, Vec3]:
        """Return the return path's points: stand, above it, above the start, start."""
        (north_m, east_m, _), high = self.stand.position_ned_m, -self.altitude_m
        to_north_m, to_east_m, _ = self.start.position_ned_m
        return (
            self.stand.position_ned_m,
            (north_m, east_m, high),
            (to_north_m, to_east_m, high),
            self.start.position_ned_m,
        )


@dataclass(frozen=True, slots=True)
class StandingPose:
    """The pose where a vehicle stood when a run ended, by its own estimate."""

    pose: Pose
    armed: bool
    stage: str


def standing_pose_of(rows: Iterable[Mapping[str, str]], name: str) -> StandingPose | None:
    """Return a vehicle's last pose in a trajectory.csv; None where unknown."""
    last = None
    for row in rows:
        if row["vehicle"] == name and row["est_north_m"]:
            last = row
    if last is None:
        return None
    place = tuple(float(last[f"est_{key}_m"]) for key in ("north", "east", "down"))
    if not all(map(math.isfinite, place)):
        return None
    north_m, east_m, down_m = place
    pose = Pose.of(north_m, east_m, -down_m, yaw_rad=float(last["est_yaw_rad"]))
    return StandingPose(pose, last["armed"] == "1", last["stage"])


def read_standing_pose(folder: Path, name: str) -> StandingPose | None:
    """Return a vehicle's pose at the end of the run in a folder; None where unknown."""
    try:
        with (folder / "trajectory.csv").open(encoding="utf-8", newline="") as file:
            return standing_pose_of(csv.DictReader(file), name)
    except (OSError, ValueError, KeyError):
        return None


def why_no_return(
    result: RunResult,
    stand: StandingPose | None,
    log: Iterable[Mapping[str, Any]],
    *,
    solid: set[str],
) -> str:
    """Return why a vehicle must not fly a return path after a run; "" where it may.

    log: events of the run. solid: names of the real world's objects.
    """
    if result.verdict in _UNSETTLED:
        return f"the run ended as {result.verdict}: {result.reason}"
    for later in result.also:
        if later.verdict in _UNSETTLED:
            return f"{later.verdict} after the verdict {result.verdict}: {later.reason}"
    if stand is None:
        return "its position is unknown"
    if stand.armed or stand.stage not in {"landed", "end"}:
        return "it has not landed and disarmed"
    touched = (
        f"{flag.text}, a real object"
        for flag in result.collisions
        if flag.vehicle == "real" and any(name in flag.text for name in solid)
    )
    return next(touched, "") or next(_forbidding_events(log), "")


def _forbidding_events(log: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    """Yield a run's log entries that forbid a return path."""
    armed = False
    for line in log:
        # Faults of an estimator before it has converged do not concern the flight.
        armed = armed or (line.get("event") == "stage" and line.get("stage") == "arm")
        if line.get("event") == "guard" and line.get("kind") in _FORBIDDING:
            yield f"the guard took over: {line.get('text')}"
        if armed and line.get("event") == "vehicle" and line.get("kind") in _FAULTS:
            yield f"{line.get('vehicle')} reported a {line.get('kind')}: {line.get('text')}"


def why_path_blocked(
    path: ReturnPath, *, fence: Fence | None, keep_m: float, probe: ClearanceProbe
) -> str:
    """Return what blocks a return path; "" for nothing. probe: real world without floors."""
    if fence is not None:
        for point in _points(path):
            if fence.margin_m(point) < keep_m:
                return f"the path leaves the fence at its {fence.boundary(point)}"
    stand, above, over, start = path.points
    legs = (_raised(stand, above), above), (above, over), (over, _raised(start, over))
    for leg in legs:
        begin, end = (Pose.of(n, e, -d, yaw_rad=path.start.yaw_rad) for n, e, d in leg)
        if near := probe.sweep(begin, 0.0, end, 1.0):
            return f"{near[0].object_name} is nearer than {CLEAR_M:g} m to the path"
    return ""


def _raised(place: Vec3, high: Vec3) -> Vec3:
    """Return a place of standing raised towards a return path, away from what is beneath it."""
    north_m, east_m, down_m = place
    return (north_m, east_m, max(high[2], down_m - _STANDS_M))


def offset_from_start_text(stand: StandingPose | None, start: Pose) -> tuple[float, float] | None:
    """Return the offset of a vehicle from its start, metres and degrees of heading."""
    if stand is None or stand.armed:
        return None
    north_m, east_m, _ = subtract(stand.pose.position_ned_m, start.position_ned_m)
    turn_rad = math.remainder(stand.pose.yaw_rad - start.yaw_rad, math.tau)
    return math.hypot(north_m, east_m), abs(math.degrees(turn_rad))


def _points(path: ReturnPath) -> Iterator[Vec3]:
    """Yield points on a return path's level part, and above both its ends."""
    _, above, over, _ = path.points
    leg = subtract(over, above)
    count = max(1, math.ceil(norm(leg) / _STEP_M))
    for index in range(count + 1):
        north_m, east_m, down_m = (a + b * index / count for a, b in zip(above, leg, strict=True))
        yield (north_m, east_m, down_m)
