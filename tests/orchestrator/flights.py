"""What a run left in its folder, for tests."""

import csv
import json
from pathlib import Path
from typing import Any


def log_of(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "log.jsonl").read_text("utf-8").splitlines()]


def rows_of(folder: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((folder / "trajectory.csv").read_text("utf-8").splitlines()))


def all_landed(folder: Path) -> bool:
    """Return whether every vehicle was last seen on the ground and disarmed, in truth."""
    last = {row["vehicle"]: row for row in rows_of(folder)}
    return all(
        row["armed"] == "0" and abs(float(row["true_down_m"])) < 0.2 for row in last.values()
    )
