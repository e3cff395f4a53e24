"""The ledger of a campaign on a cluster: its starts, and the outcome of each run.

It is `ledger.jsonl` in the campaign's folder.
"""

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from wil_campaign.foundation.files.document_writer import sync_folder

LEDGER_FILE = "ledger.jsonl"
LedgerEvent = Literal["ordered", "ended", "lost", "found"]


@dataclass(frozen=True, slots=True)
class OpenOrder:
    """A run that was ordered and has no outcome in the ledger. node: to which it was sent.

    place: the run's in the store of its start.
    """

    session: str
    run: str
    node: str
    place: str = ""


@dataclass(frozen=True, slots=True)
class CampaignPlace:
    """The place of a campaign in a store. store: its URL. place: beneath that."""

    store: str
    place: str


class RunLedger:
    """Appends to the ledger; each line is on the disk before the call returns. Raises OSError."""

    def __init__(self, folder: Path, session: str, stored: CampaignPlace | None = None) -> None:
        self._folder = folder
        self._session = session
        where = {} if stored is None else {"store": stored.store, "place": stored.place}
        _append(folder, {"session": session, "event": "begun", **where})
        sync_folder(folder)

    def write(
        self, event: LedgerEvent, run: str, node: str, text: str = "", *, place: str = ""
    ) -> None:
        """Append an event of a run. node: where it flies. place: of an ordered run in the store."""
        line = {"session": self._session, "event": event, "run": run, "node": node, "text": text}
        _append(self._folder, line | ({"place": place} if place else {}))


def close_order(folder: Path, order: OpenOrder, event: LedgerEvent, text: str) -> None:
    """Append the outcome of a run whose program was killed before that. Raises OSError."""
    where = {"session": order.session, "event": event, "run": order.run, "node": order.node}
    _append(folder, {**where, "text": text})


def first_session(folder: Path) -> str:
    """Return the first start in a campaign's ledger; "" without a ledger. Raises OSError."""
    return next(iter(_sessions(folder)), "")


def campaign_places(folder: Path) -> dict[str, CampaignPlace]:
    """Return the campaign's place in a store, by each start with a store. Raises OSError."""
    return {
        str(line.get("session", "")): CampaignPlace(str(line["store"]), str(line.get("place", "")))
        for line in _lines(folder)
        if line.get("event") == "begun" and line.get("store")
    }


def open_orders(folder: Path) -> dict[str, OpenOrder]:
    """Return the ordered runs without an outcome in a ledger, by name. Raises OSError."""
    orders: dict[str, OpenOrder] = {}
    for line in _lines(folder):
        run = str(line.get("run", ""))
        if line.get("event") == "ordered":
            session, node = str(line.get("session", "")), str(line.get("node", ""))
            orders[run] = OpenOrder(session, run, node, str(line.get("place", "")))
        elif run:
            orders.pop(run, None)
    return orders


def _sessions(folder: Path) -> list[str]:
    """Return the starts in a campaign's ledger, the oldest first."""
    return [str(line.get("session", "")) for line in _lines(folder) if line.get("event") == "begun"]


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
    """Append a line and sync it to the disk; an incomplete line before it stays separate."""
    content = (json.dumps(line, ensure_ascii=True) + "\n").encode()
    handle = os.open(folder / LEDGER_FILE, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
    try:
        size = os.fstat(handle).st_size
        is_cut = size > 0 and os.pread(handle, 1, size - 1) != b"\n"
        rest = memoryview(b"\n" + content if is_cut else content)
        while rest:  # a disk that fills up takes a part, and says so with the next one
            rest = rest[os.write(handle, rest) :]
        os.fsync(handle)
    finally:
        os.close(handle)
