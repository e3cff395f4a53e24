"""The ledger of a search: each batch that was begun, and its outcomes, as lines of JSON.

It alone decides which batches a resumed search flies again. An incomplete last line is ignored.
"""

import dataclasses
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from wil_campaign.foundation.files.document_writer import sync_folder, to_json, write_atomically
from wil_campaign.plugins.search.errors import SearchError
from wil_campaign.plugins.search.exploration.model import FlightBatch, FlightOutcome

FILE_NAME = "ledger.jsonl"


@cache
def _outcomes_model() -> TypeAdapter[tuple[FlightOutcome, ...]]:
    return TypeAdapter(tuple[FlightOutcome, ...])


@dataclass(slots=True)
class LedgerContents:
    """The contents of a ledger. at_once: how many flights the search proposes at once.

    batches: as they were begun; outcomes: of finished batches; both by number. code: digests of
    what finished flights have imported, by path relative to the campaign file.
    """

    at_once: int
    batches: dict[int, Any] = field(default_factory=dict)
    outcomes: dict[int, tuple[FlightOutcome, ...]] = field(default_factory=dict)
    code: dict[str, str] = field(default_factory=dict)
    is_broken: bool = False


def read_ledger(text: str) -> LedgerContents:
    """Return the contents of a ledger's text; an incomplete last line is ignored.

    Raises SearchError for a damaged line.
    """
    lines = text.split("\n")[:-1]
    contents: LedgerContents | None = None
    for number, line in enumerate(lines, start=1):
        try:
            entry = json.loads(line)
            if contents is None:
                contents = LedgerContents(int(entry["at_once"]))
            elif "begun" in entry:
                contents.batches[int(entry["begun"]["number"])] = entry["begun"]
            else:
                outcomes = _outcomes_model().validate_json(
                    json.dumps(entry["outcomes"]), strict=True
                )
                contents.outcomes[int(entry["flown"])] = outcomes
                contents.code |= dict(entry.get("code", {}))
                contents.is_broken |= bool(entry["is_broken"])
        except (ValueError, KeyError, TypeError, ValidationError) as error:
            text = f"line {number} of {FILE_NAME} is damaged ({type(error).__name__})"
            raise SearchError(f"{text}: start the search again without --resume") from error
    if contents is None:
        raise SearchError(f"{FILE_NAME} is empty: start the search again without --resume")
    return contents


class SearchLedger:
    """A ledger on the disk; each line is synced before the call returns. Raises OSError."""

    def __init__(self, path: Path, contents: LedgerContents) -> None:
        self._path = path
        self._contents = contents

    @classmethod
    def new(cls, folder: Path, *, at_once: int) -> "SearchLedger":
        """Return the ledger of a new search."""
        path = folder / FILE_NAME
        write_atomically(path, to_json({"at_once": at_once}, indent=None))
        return cls(path, LedgerContents(at_once))

    @classmethod
    def resumed(cls, folder: Path) -> "SearchLedger":
        """Return the ledger of an interrupted search. Raises SearchError."""
        path = folder / FILE_NAME
        try:
            text = path.read_bytes().decode("utf-8", "replace")
        except OSError as error:
            reason = error.strerror or error
            raise SearchError(f"{path} cannot be read: {reason}; start without --resume") from error
        contents = read_ledger(text)
        whole = text[: text.rfind("\n") + 1]
        if whole != text:
            write_atomically(path, whole)
        return cls(path, contents)

    @property
    def at_once(self) -> int:
        """Return how many flights the search proposes at once, which affects its proposals."""
        return self._contents.at_once

    @property
    def is_broken(self) -> bool:
        """Return whether a batch had an internal error."""
        return self._contents.is_broken

    @property
    def code(self) -> Mapping[str, str]:
        """Return the digests of what finished flights have imported, by path."""
        return self._contents.code

    def outcomes(self, batch: FlightBatch) -> tuple[FlightOutcome, ...] | None:
        """Return the outcomes of a batch; None if it is not finished.

        Raises SearchError if the ledger has another batch with this number.
        """
        begun = self._contents.batches.get(batch.number)
        if begun is not None and begun != _to_json_values(batch):
            raise SearchError(
                f"{self._path} cannot be resumed: its batch {batch.number} differs from what the "
                "search proposes now (another version of optuna, scipy or NumPy may do that): "
                "start the search again without --resume"
            )
        return self._contents.outcomes.get(batch.number)

    def begin(self, batch: FlightBatch) -> None:
        """Record that a batch begins, unless that is recorded already."""
        if batch.number not in self._contents.batches:
            plain = _to_json_values(batch)
            self._contents.batches[batch.number] = plain
            self._append({"begun": plain})

    def finish(
        self,
        batch: FlightBatch,
        outcomes: Sequence[FlightOutcome],
        *,
        code: Mapping[str, str],
        is_broken: bool,
    ) -> None:
        """Record the outcomes of a batch. code: digests of what its flights imported, by path."""
        self._contents.outcomes[batch.number] = tuple(outcomes)
        self._contents.is_broken |= is_broken
        new = {name: digest for name, digest in code.items() if name not in self._contents.code}
        self._contents.code |= new
        plain = [dataclasses.asdict(outcome) for outcome in outcomes]
        entry = {"flown": batch.number, "outcomes": plain, "code": new, "is_broken": is_broken}
        self._append(entry)

    def _append(self, entry: dict[str, object]) -> None:
        with self._path.open("ab") as stream:
            stream.write(to_json(entry, indent=None).encode())
            stream.flush()
            os.fsync(stream.fileno())
        sync_folder(self._path.parent)


def _to_json_values(batch: FlightBatch) -> Any:
    return json.loads(to_json(batch, indent=None))
