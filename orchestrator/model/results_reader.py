"""Reads result.json and summary.json; refuses a result.json that was changed or damaged."""

from functools import cache
from pathlib import Path
from typing import TypeVar

from pydantic import TypeAdapter, ValidationError

from orchestrator.model.campaign_results import Summary
from orchestrator.model.document_writer import to_json
from orchestrator.model.results import RunResult
from worlds.files.limited_json import JsonLimitError, check_values, read_limited

T = TypeVar("T")


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
    if _as_written(result) != text:
        raise ResultError(f"{path} was edited, or written by another version of wil-campaign")
    return result


def read_summary(path: Path) -> Summary:
    """Return the summary in a summary.json, also of an earlier version. Raises ResultError."""
    return _parse_document(path, summary_model())[0]


def _parse_document(path: Path, kind: TypeAdapter[T]) -> tuple[T, str]:
    """Return the content of a document, and its text. Raises ResultError."""
    try:
        data = read_limited(path)
        check_values(data)
        text = data.decode("utf-8")
    except FileNotFoundError as error:
        raise ResultError(f"{path} does not exist") from error
    except (OSError, JsonLimitError, UnicodeDecodeError) as error:
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


def _as_written(result: RunResult) -> str:
    """Return a result as wil-campaign writes it; empty for numbers that JSON does not have."""
    try:
        return to_json(result)
    except ValueError:
        return ""
