"""The ledger of a campaign on a cluster: which start of it may fly, and what became of each run.

`ledger.jsonl` in the campaign's folder. A node reads it before each flight: only runs of the newest
start are flown, whatever a cluster still delivers of an earlier one.
"""

import json
import os
from pathlib import Path
from typing import Literal

from orchestrator.model.document_writer import sync_folder

LEDGER_FILE = "ledger.jsonl"
LedgerEvent = Literal["ordered", "ended", "lost", "found"]


class RunLedger:
    """Appends to the ledger, each line on the disk before anything else happens. Raises OSError."""

    def __init__(self, folder: Path, session: str) -> None:
        self._path = folder / LEDGER_FILE
        self._session = session
        self._append({"event": "begun"})
        sync_folder(folder)

    def write(self, event: LedgerEvent, run: str, node: str, text: str = "") -> None:
        """Add what became of a run. node: where."""
        self._append({"event": event, "run": run, "node": node, "text": text})

    def _append(self, line: dict[str, str]) -> None:
        content = json.dumps({"session": self._session, **line}, ensure_ascii=True) + "\n"
        handle = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        try:
            os.write(handle, content.encode())
            os.fsync(handle)
        finally:
            os.close(handle)


def newest_session(folder: Path) -> str:
    """Return the newest start in a campaign's ledger; "" without a ledger. Raises OSError."""
    newest = ""
    try:
        lines = (folder / LEDGER_FILE).read_text("utf-8").splitlines()
    except FileNotFoundError:
        return ""
    for text in lines:
        try:
            line = json.loads(text)
        except ValueError:
            continue  # cut off by a power failure
        if isinstance(line, dict) and line.get("event") == "begun":
            newest = str(line.get("session", ""))
    return newest
