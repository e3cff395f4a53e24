"""Flies one order in a worker process: looks up what it names, flies, writes the result."""

import cv2

from orchestrator.operator import Inbox
from orchestrator.progress import Report
from orchestrator.results import RunResult
from orchestrator.run.run import fly
from orchestrator.run.setup import RunOrder, RunSetup
from orchestrator.writing import to_json, write_whole
from worlds.references import forget_loaded


def fly_order(order: RunOrder, report: Report, inbox: Inbox) -> RunResult:
    """Fly a run and write its result.json; returns the result when it is on the disk."""
    cv2.setNumThreads(1)  # runs share the cores by processes
    forget_loaded()  # else the runs that a worker flew before this one could tell
    order.folder.mkdir(parents=True, exist_ok=True)
    result = fly(RunSetup.of(order), report, inbox)
    write_whole(order.folder / "result.json", to_json(result))
    return result
