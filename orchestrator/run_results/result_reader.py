"""Reads result.json and summary.json; refuses a result.json that was changed or damaged."""

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from wil_campaign.foundation.files.document_writer import plain_document, to_json
from wil_campaign.foundation.files.limited_json import (
    JsonLimitError,
    check_json_values,
    read_limited_bytes,
)
from wil_campaign.orchestrator.run_results.campaign_results import Summary
from wil_campaign.orchestrator.run_results.run_result import RunResult

T = TypeVar("T")

_ADDED: Mapping[str, object] = {
    "unmoved": (),
    "no_retry": "",
    "slow": (),
    "views_ended": (),
    "code": {},
    "firmware": (),
    "evidence_files": {},
}
"""Fields that a result.json of an earlier version does not have, with what they are then."""
_ADDED_TO_EVIDENCE: Mapping[str, object] = {"caveat": ""}


class ResultError(Exception):
    """A result.json or summary.json that is missing, truncated, damaged or of another version."""


@cache
def result_model() -> TypeAdapter[RunResult]:
    """Return the validator of a result.json; it takes 50 ms to build, and few commands read any."""
    return TypeAdapter(RunResult)


@cache
def summary_model() -> TypeAdapter[Summary]:
    """Return the validator of a summary.json."""
    return TypeAdapter(Summary)


def read_result(path: Path) -> RunResult:
    """Return the result in a result.json. Raises ResultError."""
    result, text = _parse_document(path, result_model())
    if not _is_as_written(result, text):
        raise ResultError(f"{path} was edited, or written by another version of wil-campaign")
    return result


def read_summary(path: Path) -> Summary:
    """Return the summary in a summary.json, also of an earlier version. Raises ResultError."""
    return _parse_document(path, summary_model())[0]


def _parse_document(path: Path, kind: TypeAdapter[T]) -> tuple[T, str]:
    """Return the content of a document, and its text. Raises ResultError."""
    try:
        data = read_limited_bytes(path)
        check_json_values(data)
        text = data.decode("utf-8")
    except FileNotFoundError as error:
        raise ResultError(f"{path} does not exist") from error
    except UnicodeDecodeError as error:
        raise ResultError(f"{path} is damaged: it is not UTF-8 at byte {error.start}") from error
    except (OSError, JsonLimitError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ResultError(f"{path} cannot be read: {reason}") from error
    try:
        return kind.validate_json(text, strict=True), text
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        reason = f"{where}: {first['msg']}" if where else first["msg"]
        raise ResultError(
            f"{path} is truncated, damaged or of another version: {reason}"
        ) from error


def _is_as_written(result: RunResult, text: str) -> bool:
    """Return whether a document is what wil-campaign, or an earlier version of it, writes."""
    fields = plain_document(result)
    written = json.loads(text)
    _leave_out(_ADDED, fields, written)
    for entry, as_written in zip(fields["evidence"], written.get("evidence", ()), strict=True):
        _leave_out(_ADDED_TO_EVIDENCE, entry, as_written)
    try:
        return to_json(fields) == text
    except ValueError:  # numbers that JSON does not have
        return False


def _leave_out(
    added: Mapping[str, object], fields: dict[str, Any], written: Mapping[str, object]
) -> None:
    """Leave out of a document what its earlier version did not have."""
    for name, value in added.items():
        if name not in written and fields[name] == value:
            del fields[name]
