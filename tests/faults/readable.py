"""Whether what a run left behind can be read."""

import csv
import json
from collections.abc import Callable
from pathlib import Path

from wil_campaign.orchestrator.run_results.result_reader import read_result
from wil_campaign.plugins.python.mcap_reader import Recording


def unreadable(folder: Path) -> list[str]:
    """Return which files of a run cannot be read, and why."""
    readers: dict[str, Callable[[Path], object]] = {
        "trajectory.csv": lambda path: list(csv.DictReader(path.read_text("utf-8").splitlines())),
        "log.jsonl": read_lines,
        "guard.jsonl": read_lines,
        "run.mcap": lambda path: sum(1 for _ in Recording(path)),
        "result.json": read_result,
    }
    found = []
    for name, read in readers.items():
        path = folder / name
        if not path.exists():
            continue
        try:
            read(path)
        except Exception as error:  # noqa: BLE001 - whatever it is, it is what we look for
            found.append(f"{name}: {type(error).__name__}: {error}")
    return found


def read_lines(path: Path) -> list[dict[str, object]]:
    """Return the objects of a file of JSON lines; the last line may have been cut off."""
    whole = path.read_text("utf-8").rpartition("\n")[0]
    return [json.loads(line) for line in whole.splitlines()]
