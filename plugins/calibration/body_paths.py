"""The path of a camera's body for calibration, from a CSV file or a recorded run."""

import csv
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wil_campaign.orchestrator.recording.judge_log_file import FILE_NAME
from wil_campaign.plugins.calibration.boards import Points
from wil_campaign.plugins.offline.errors import OfflineError
from wil_campaign.safety.evaluation.judge_log import JudgeLogError, read_judge_log
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.worlds.frames import Pose

COLUMNS = ("t_s", "north_m", "east_m", "down_m", "qw", "qx", "qy", "qz")

TimedPose = tuple[float, Pose]


@dataclass(frozen=True, slots=True)
class BodyPath:
    """The body's path for the mounting: times, positions (n, 3) NED, attitudes (n, 4) wxyz."""

    t_s: Points
    position_ned_m: Points
    q_wxyz: Points


def body_path(poses: Iterable[TimedPose]) -> BodyPath:
    """Return timed poses (NED, FRD) as the body's path."""
    given = list(poses)
    return BodyPath(
        t_s=np.array([t_s for t_s, _ in given], np.float64),
        position_ned_m=np.array([pose.position_ned_m for _, pose in given], np.float64),
        q_wxyz=np.array([pose.q_wxyz for _, pose in given], np.float64),
    )


def body_path_in_csv(path: Path) -> BodyPath:
    """Return the body's path in a CSV file with the columns of COLUMNS, ignoring others.

    Raises OfflineError, with the line.
    """
    if path.exists() and not path.is_file():  # a device has no end
        raise OfflineError(f"{path}: is not a file")
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            rows = csv.DictReader(stream)
            missing = [name for name in COLUMNS if name not in (rows.fieldnames or ())]
            if missing:
                raise OfflineError(
                    f"{path}:1: has no column {', '.join(missing)}; poses need {', '.join(COLUMNS)}"
                )
            return body_path([_pose(path, rows.line_num, row) for row in rows])
    except OSError as error:
        raise OfflineError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (csv.Error, UnicodeDecodeError) as error:
        raise OfflineError(f"{path}: is not a CSV file: {error}") from error


def body_path_in_run(folder: Path, vehicle: str) -> BodyPath:
    """Return a body's path in a recorded run, by its pose source. Raises OfflineError."""
    file = folder / FILE_NAME
    try:
        with file.open("rb") as stream:
            samples = [
                (pose_sample.t_s, pose_sample.pose)
                for pose_sample in read_judge_log(stream)
                if isinstance(pose_sample, PoseSample) and pose_sample.vehicle == vehicle
            ]
    except OSError as error:
        raise OfflineError(f"{file}: cannot be read: {error.strerror or error}") from error
    except JudgeLogError as error:
        raise OfflineError(f"{file}: cannot be read: {error}") from error
    return body_path(samples)


def _pose(path: Path, line: int, row: dict[str, str | None]) -> TimedPose:
    """Return the body's pose in a row of a CSV path. Raises OfflineError."""
    try:
        t_s, north, east, down, *q = (float(row[name] or "") for name in COLUMNS)
    except ValueError as error:
        raise OfflineError(f"{path}:{line}: {error}") from error
    length = math.hypot(*q)
    if not all(map(math.isfinite, (t_s, north, east, down))) or not 0.5 < length < 2.0:
        raise OfflineError(
            f"{path}:{line}: is not a pose: it needs finite numbers, and q of length 1"
        )
    w, x, y, z = (part / length for part in q)
    return t_s, Pose((north, east, down), (w, x, y, z))
