"""trajectory.csv: estimates, truths, setpoints and notes; a row that is none is counted."""

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from orchestrator.report.model import Commanded
from orchestrator.report.reading.results_folder import UnreadableError, read_text
from worlds.frames import Vec3

_NEEDED = frozenset({"t_s", "vehicle", "stage"})


@dataclass(frozen=True, slots=True)
class TrajectoryRows:
    """The rows in the order of the file."""

    rows: tuple[Commanded, ...] = ()
    problems: tuple[str, ...] = ()


def read_trajectory(path: Path) -> TrajectoryRows:
    """Return the rows of a trajectory, as far as they can be read."""
    try:
        lines = read_text(path).replace("\0", "").splitlines(keepends=True)
    except UnreadableError as error:
        return TrajectoryRows(problems=(str(error),))
    reader = csv.DictReader(lines)
    try:
        if not set(reader.fieldnames or ()) >= _NEEDED:
            return TrajectoryRows(
                problems=(f"{path.name} is none of ours: no t_s, vehicle, stage",)
            )
        found = [_row(cells) for cells in reader]
    except csv.Error as error:
        return TrajectoryRows(problems=(f"{path.name} is damaged: {error}",))
    rows = tuple(row for row in found if row is not None)
    damaged = len(found) - len(rows)
    # The last line of a run that was killed may be cut.
    problems = (f"{path.name}: {damaged} rows cannot be read",) if damaged else ()
    return TrajectoryRows(rows, problems)


def _row(cells: Mapping[str, str | None]) -> Commanded | None:
    t_s = _number(cells, "t_s")
    if t_s is None or not cells.get("vehicle"):
        return None
    return Commanded(
        t_s=t_s,
        vehicle=cells["vehicle"] or "",
        stage=cells.get("stage") or "",
        mode=cells.get("mode") or "",
        is_armed=cells.get("armed") == "1",
        position_ned_m=_vector(cells, "est_north_m", "est_east_m", "est_down_m"),
        velocity_ned_m_s=_vector(cells, "est_v_north_m_s", "est_v_east_m_s", "est_v_down_m_s"),
        truth_ned_m=_vector(cells, "true_north_m", "true_east_m", "true_down_m"),
        setpoint_kind=cells.get("sp_kind") or "",
        setpoint=_vector(cells, "sp_north", "sp_east", "sp_down"),
        setpoint_yaw_rad=_number(cells, "sp_yaw_rad"),
        note=cells.get("note") or "",
    )


def _number(cells: Mapping[str, str | None], name: str) -> float | None:
    try:
        number = float(cells.get(name) or "nan")
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def _vector(cells: Mapping[str, str | None], *names: str) -> Vec3 | None:
    x, y, z = (_number(cells, name) for name in names)
    return None if x is None or y is None or z is None else (x, y, z)
