"""The motion of a run under its goal at even times, from judged.msgpack and trajectory.csv."""

import bisect
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wil_campaign.orchestrator.reading.judged_motion import read_judged_motion
from wil_campaign.orchestrator.reading.model import CommandedState
from wil_campaign.orchestrator.reading.trajectory_file import read_trajectory
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.jit import F64

STEP_S = 0.1
_LEAST, _MOST = 5, 3000
"""Samples of a motion: fewer cannot be compared, more take too long to compare."""
_MOST_LATE_S = 1.0
"""The last row may be so much earlier than the last sample: rows come several times a second."""


class MotionError(Exception):
    """The motion of a run cannot be compared; the message says why."""


@dataclass(frozen=True, slots=True)
class RunMotion:
    """The judged vehicle from the moment its goal was given until it was done, every STEP_S.

    positions_ned_m (samples, 3): as judged. commands (samples, 3): the setpoints of the autonomy,
    by kind "velocity" in m/s or "position" in m, NED; answers: the same quantity of the vehicle.
    kind: empty, with no rows, where no setpoints of one kind were recorded. seed: of the run;
    flights of one seed had the same gusts and the same moving objects, whatever their mode.
    """

    positions_ned_m: F64
    kind: str
    commands: F64
    answers: F64
    seed: int


def read_motion(folder: Path, vehicle: str, seed: int) -> RunMotion:
    """Return the motion of a vehicle in the folder of a run of a seed. Raises MotionError."""
    judged = read_judged_motion(folder / "judged.msgpack")
    poses, begin_s = judged.poses.get(vehicle), judged.stages.get("goal")
    if judged.problems:
        raise MotionError(judged.problems[0])
    if not poses or begin_s is None:
        raise MotionError(f"no poses of {vehicle} under the goal")
    ends = [judged.stages[name] for name in ("done", "land", "end") if name in judged.stages]
    times = _even_times(begin_s, min([*ends, poses[-1][0]]))
    given = _rows(folder / "trajectory.csv", vehicle, float(times[-1]))
    kind, commands, answers = _commands(
        [commanded for commanded in given if commanded.setpoint], times
    )
    return RunMotion(_positions(poses, times), kind, commands, answers, seed)


def _rows(path: Path, vehicle: str, end_s: float) -> list[CommandedState]:
    """Return a vehicle's rows of a trajectory; empty without the file. Raises MotionError.

    A damaged one is refused: its last row before the damage would stand for all that are missing.
    """
    if not path.exists():
        return []
    found = read_trajectory(path)
    if found.problems:
        raise MotionError(found.problems[0])
    rows = [row for row in found.rows if row.vehicle == vehicle]
    if not rows:
        raise MotionError(f"{path.name} has no row of {vehicle}")
    if rows[-1].t_s < end_s - _MOST_LATE_S:
        raise MotionError(
            f"{path.name} ends at {rows[-1].t_s:.2f} s, before the goal's end at {end_s:.2f} s"
        )
    return [row.decoded() for row in rows]


def _even_times(begin_s: float, end_s: float) -> F64:
    count = int((end_s - begin_s) / STEP_S + 1e-6) + 1
    if count < _LEAST:
        raise MotionError(f"the goal was flown for only {max(0.0, end_s - begin_s):.1f} s")
    if count > _MOST:
        raise MotionError(f"the goal was flown for {end_s - begin_s:.0f} s: too long to compare")
    return begin_s + STEP_S * np.arange(count, dtype=np.float64)


def _positions(poses: Sequence[tuple[float, Pose]], times: F64) -> F64:
    stamps = np.array([t_s for t_s, _ in poses])
    places = np.array([pose.position_ned_m for _, pose in poses])
    return np.stack([np.interp(times, stamps, places[:, axis]) for axis in range(3)], axis=1)


def _commands(rows: Sequence[CommandedState], times: F64) -> tuple[str, F64, F64]:
    """Return kind, commands and answers: the newest row at each time."""
    nothing = np.zeros((0, 3))
    stamps = [row.t_s for row in rows]
    # A time before the first command takes the first command, a tick early.
    newest = [max(0, bisect.bisect_right(stamps, t_s + 1e-6) - 1) for t_s in times]
    chosen = [rows[index] for index in newest] if rows else []
    kinds = {row.setpoint_kind for row in chosen}
    if len(kinds) != 1:
        return "", nothing, nothing
    kind = kinds.pop()
    answers = [
        row.velocity_ned_m_s if kind == "velocity" else row.truth_ned_m or row.position_ned_m
        for row in chosen
    ]
    if any(answer is None for answer in answers):
        return "", nothing, nothing
    return kind, np.array([row.setpoint for row in chosen]), np.array(answers, np.float64)
