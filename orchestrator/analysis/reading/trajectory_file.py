"""trajectory.csv: estimates, truths, setpoints and notes; a row that is none is counted."""

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from orchestrator.analysis.model import Commanded
from orchestrator.analysis.reading.results_folder import UnreadableError, read_text
from worlds.frames import Vec3

_NEEDED = frozenset({"t_s", "vehicle", "stage"})


@dataclass(frozen=True, slots=True)
class Row:
    """A row whose cells are decoded when they are asked for: few of them are shown."""

    t_s: float
    vehicle: str
    cells: Mapping[str, str | None]

    def decoded(self) -> Commanded:
        """Return all that the row tells."""
        cells = self.cells
        return Commanded(
            t_s=self.t_s,
            vehicle=self.vehicle,
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


@dataclass(frozen=True, slots=True)
class TrajectoryRows:
    """The rows in the order of the file."""

    rows: tuple[Row, ...] = ()
    problems: tuple[str, ...] = ()


def read_trajectory(path: Path) -> TrajectoryRows:
    """Return the rows of a trajectory, as far as they can be read."""
    try:
        lines = read_text(path).replace("\0", "").splitlines(keepends=True)
    except UnreadableError as error:
        return TrajectoryRows(problems=(str(error),))
    is_cut = bool(lines) and not lines[-1].endswith("\n")
    reader = csv.DictReader(lines[:-1] if is_cut else lines)
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
    problems = [f"{path.name}: {damaged} rows cannot be read"] if damaged else []
    if is_cut:
        problems.append(f"{path.name} is cut off in the middle of a row")
    return TrajectoryRows(rows, tuple(problems))


def _row(cells: Mapping[str, str | None]) -> Row | None:
    t_s, vehicle = _number(cells, "t_s"), cells.get("vehicle")
    return None if t_s is None or not vehicle else Row(t_s, vehicle, cells)


def _number(cells: Mapping[str, str | None], name: str) -> float | None:
    try:
        number = float(cells.get(name) or "nan")
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def _vector(cells: Mapping[str, str | None], *names: str) -> Vec3 | None:
    x, y, z = (_number(cells, name) for name in names)
    return None if x is None or y is None or z is None else (x, y, z)
