"""The trajectory file trajectory.csv: true poses, estimates and setpoints of all vehicles."""

import csv
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple, Self

from wil_campaign.foundation.background_file import BackgroundFile
from wil_campaign.vehicles.setpoints import PositionSetpoint, Setpoint, VelocitySetpoint
from wil_campaign.worlds.frames import Pose, Vec3, euler_from_quat

_POSE = ("north_m", "east_m", "down_m", "roll_rad", "pitch_rad", "yaw_rad")
COLUMNS = (
    "t_s",
    "vehicle",
    "stage",
    "mode",
    "armed",
    *(f"est_{name}" for name in _POSE),
    "est_v_north_m_s",
    "est_v_east_m_s",
    "est_v_down_m_s",
    *(f"true_{name}" for name in _POSE),
    "sp_kind",
    "sp_north",
    "sp_east",
    "sp_down",
    "sp_yaw_rad",
    "note",
)
"""World frame, NED. Setpoint components are metres (position) or m/s (velocity) by sp_kind.

An unknown value (no ground truth of attached hardware, no setpoint yet) is empty.
"""


class TrajectoryRow(NamedTuple):
    """A row of a trajectory: one moment of one vehicle."""

    t_s: float
    vehicle: str
    stage: str
    mode: str
    armed: bool
    estimate: Pose | None
    velocity_ned_m_s: Vec3 | None
    truth: Pose | None
    setpoint: Setpoint | None
    note: str


class TrajectoryWriter:
    """Writes trajectory.csv; a context manager."""

    def __init__(self, *, path: Path) -> None:
        self._path = path

    def __enter__(self) -> Self:
        self._file = BackgroundFile(self._path)
        self._file.write((",".join(COLUMNS) + "\n").encode())
        self._last_flush_s = 0.0
        return self

    @property
    def is_removed(self) -> bool:
        """Return whether the file was removed, as of its last flush, or of its end."""
        return self._file.is_removed

    def write(self, row: TrajectoryRow) -> None:
        """Append one row to the trajectory."""
        velocity = _vector(row.velocity_ned_m_s)
        cells = (
            f"{row.t_s:.4f},{row.vehicle},{row.stage},{row.mode},{int(row.armed)}",
            _pose(row.estimate),
            velocity,
            _pose(row.truth),
            _setpoint(row.setpoint),
            _text(row.note),
        )
        self._file.write((",".join(cells) + "\n").encode())
        if row.t_s - self._last_flush_s >= 1.0:
            self._last_flush_s = row.t_s
            self._file.flush()

    def __exit__(self, *_: object) -> None:
        self._file.close()


def recorded_note(path: Path, vehicle: str, t_s: float) -> str:
    """Return a vehicle's newest note until a time by a trajectory; "" without one.

    A row that is cut or damaged has none, nor has a file that cannot be read.
    """
    note = ""
    with suppress(OSError, csv.Error), path.open(encoding="utf-8", errors="replace") as stream:
        for row in csv.reader(stream):
            with suppress(ValueError):
                if len(row) == len(COLUMNS) and row[1] == vehicle and float(row[0]) <= t_s:
                    note = row[-1]
    return note


def _text(text: str) -> str:
    """Return text as a CSV cell of the trajectory (RFC 4180)."""
    if any(letter in text for letter in ',"\r\n'):
        return '"' + text.replace('"', '""') + '"'
    return text


def _vector(vector: Vec3 | None) -> str:
    """Return a vector as the trajectory's CSV cells; empty for None."""
    if vector is None:
        return ",,"
    x, y, z = vector
    return f"{x:.6f},{y:.6f},{z:.6f}"


def _pose(pose: Pose | None) -> str:
    """Return a pose as the trajectory's CSV cells: position and Euler angles."""
    if pose is None:
        return ",,,,,"
    return f"{_vector(pose.position_ned_m)},{_vector(euler_from_quat(pose.q_wxyz))}"


def _setpoint(setpoint: Setpoint | None) -> str:
    match setpoint:
        case PositionSetpoint(position, yaw_rad):
            kind, vector = "position", position
        case VelocitySetpoint(velocity, yaw_rad, _):
            kind, vector = "velocity", velocity
        case None:
            return ",,,,"
    yaw = "" if yaw_rad is None else f"{yaw_rad:.6f}"
    return f"{kind},{_vector(vector)},{yaw}"
