"""Reads trajectory.csv: estimates, true positions, setpoints, notes; counts damaged rows."""

import csv
import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO, TextIOWrapper
from itertools import islice
from pathlib import Path

from wil_campaign.foundation.files.limits import MAX_TRAJECTORY_ROWS
from wil_campaign.orchestrator.reading.model import CommandedState
from wil_campaign.orchestrator.reading.results_folder import UnreadableError, read_limited_data
from wil_campaign.worlds.frames import Vec3

_NEEDED = frozenset({"t_s", "vehicle", "stage"})
_BETWEEN = "\0"
"""Between the cells of a row that is kept: no cell has it, as `read_trajectory` drops it."""


@dataclass(frozen=True, slots=True)
class TrajectoryFileRow:
    """A row of trajectory.csv; its cells are decoded on demand, because few rows are shown.

    line: all cells in one text, with `_BETWEEN` between them: a long flight has a million rows.
    """

    t_s: float
    vehicle: str
    columns: Mapping[str, int]
    line: str

    def decoded(self) -> CommandedState:
        """Return the row with all cells decoded."""
        cells = self.cells
        return CommandedState(
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

    @property
    def note(self) -> str:
        """Return the autonomy's note, without decoding the rest of the row."""
        return self.cells.get("note") or ""

    @property
    def cells(self) -> dict[str, str]:
        """Return the row's cells by their columns; a short row lacks its last ones."""
        line = self.line.split(_BETWEEN)
        return {name: line[at] for name, at in self.columns.items() if at < len(line)}


@dataclass(frozen=True, slots=True)
class TrajectoryRows:
    """The rows in the order of the file."""

    rows: tuple[TrajectoryFileRow, ...] = ()
    problems: tuple[str, ...] = ()


def read_trajectory(path: Path) -> TrajectoryRows:
    """Return the readable rows of a trajectory."""
    try:
        data = read_limited_data(path).replace(b"\0", b"")
    except UnreadableError as error:
        return TrajectoryRows(problems=(str(error),))
    whole = data if data.endswith(b"\n") else data[: data.rfind(b"\n") + 1]
    reader = csv.reader(TextIOWrapper(BytesIO(whole), "utf-8", "replace", newline=""))
    try:
        columns = {name: number for number, name in enumerate(next(reader, ()))}
        if not columns.keys() >= _NEEDED:
            why = f"{path.name} is not a trajectory: it has no columns t_s, vehicle, stage"
            return TrajectoryRows(problems=(why,))
        lines = (line for line in reader if line)
        found = [_row(columns, line) for line in islice(lines, MAX_TRAJECTORY_ROWS)]
        is_longer = next(lines, None) is not None
    except csv.Error as error:
        return TrajectoryRows(problems=(f"{path.name} is damaged: {error}",))
    rows = tuple(row for row in found if row is not None)
    damaged = len(found) - len(rows)
    problems = [f"{path.name}: {damaged} rows cannot be read"] if damaged else []
    if is_longer:
        problems.append(f"{path.name}: only its first {MAX_TRAJECTORY_ROWS:,} rows are read")
    if len(whole) != len(data):
        problems.append(f"{path.name} is cut off in the middle of a row")
    return TrajectoryRows(rows, tuple(problems))


def _row(columns: Mapping[str, int], line: list[str]) -> TrajectoryFileRow | None:
    try:
        t_s, vehicle = float(line[columns["t_s"]]), line[columns["vehicle"]]
    except (ValueError, IndexError):
        return None
    return (
        TrajectoryFileRow(t_s, sys.intern(vehicle), columns, _BETWEEN.join(line))
        if vehicle and math.isfinite(t_s)
        else None
    )


def _number(cells: Mapping[str, str], name: str) -> float | None:
    try:
        number = float(cells.get(name) or "nan")
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def _vector(cells: Mapping[str, str], *names: str) -> Vec3 | None:
    x, y, z = (_number(cells, name) for name in names)
    return None if x is None or y is None or z is None else (x, y, z)
