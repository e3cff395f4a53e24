"""The ledger of a campaign on a cluster: which start of it may fly, and what became of each run.

`ledger.jsonl` in the campaign's folder. A node reads it before each flight: only runs of the newest
start are flown, whatever a cluster still delivers of an earlier one.
"""

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from orchestrator.model.document_writer import sync_folder

LEDGER_FILE = "ledger.jsonl"
LedgerEvent = Literal["ordered", "ended", "lost", "found"]


@dataclass(frozen=True, slots=True)
class OpenOrder:
    """A run that was ordered, and of which the ledger has no outcome. node: to which it went."""

    session: str
    run: str
    node: str


class RunLedger:
    """Appends to the ledger, each line on the disk before anything else happens. Raises OSError."""

    def __init__(self, folder: Path, session: str) -> None:
        self._folder = folder
        self._session = session
        _append(folder, {"session": session, "event": "begun"})
        sync_folder(folder)

    def write(self, event: LedgerEvent, run: str, node: str, text: str = "") -> None:
        """Add what became of a run. node: where."""
        line = {"session": self._session, "event": event, "run": run, "node": node, "text": text}
        _append(self._folder, line)


def close_order(folder: Path, order: OpenOrder, event: LedgerEvent, text: str) -> None:
    """Add what became of a run whose program was killed before it could. Raises OSError."""
    where = {"session": order.session, "event": event, "run": order.run, "node": order.node}
    _append(folder, {**where, "text": text})


def newest_session(folder: Path) -> str:
    """Return the newest start in a campaign's ledger; "" without a ledger. Raises OSError."""
    begun = (line for line in _lines(folder) if line.get("event") == "begun")
    return next((str(line.get("session", "")) for line in reversed([*begun])), "")


def open_orders(folder: Path) -> dict[str, OpenOrder]:
    """Return the runs of a campaign's ledger that were ordered and have no outcome; by name.

    Raises OSError.
    """
    found: dict[str, OpenOrder] = {}
    for line in _lines(folder):
        run = str(line.get("run", ""))
        if line.get("event") == "ordered":
            session, node = str(line.get("session", "")), str(line.get("node", ""))
            found[run] = OpenOrder(session, run, node)
        elif run:
            found.pop(run, None)
    return found


def _lines(folder: Path) -> Iterator[dict[str, object]]:
    """Yield the lines of a campaign's ledger; none without one."""
    try:
        text = (folder / LEDGER_FILE).read_text("utf-8", "replace")
    except FileNotFoundError:
        return
    for one in text.splitlines():
        try:
            line = json.loads(one)
        except ValueError:
            continue  # cut off by a power failure
        if isinstance(line, dict):
            yield line


def _append(folder: Path, line: dict[str, str]) -> None:
    """Add a line, which is on the disk then; what was cut off before it stays a line of its own."""
    content = (json.dumps(line, ensure_ascii=True) + "\n").encode()
    handle = os.open(folder / LEDGER_FILE, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
    try:
        size = os.fstat(handle).st_size
        is_cut = size > 0 and os.pread(handle, 1, size - 1) != b"\n"
        os.write(handle, b"\n" + content if is_cut else content)
        os.fsync(handle)
    finally:
        os.close(handle)
