"""Reads result.json back, and trusts it only when it is whole and as we write it."""

from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from orchestrator.model.document_writer import to_json
from orchestrator.model.results import RunResult

_RESULT = TypeAdapter(RunResult)


class ResultError(Exception):
    """A result.json that is missing, cut, damaged or of another version; which and why."""


def read_result(path: Path) -> RunResult:
    """Return the result in a result.json. Raises ResultError."""
    try:
        text = path.read_text("utf-8")
    except FileNotFoundError as error:
        raise ResultError(f"{path} does not exist") from error
    except (OSError, UnicodeDecodeError) as error:
        said = getattr(error, "strerror", None) or error
        raise ResultError(f"{path} cannot be read: {said}") from error
    try:
        result = _RESULT.validate_json(text, strict=True)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        said = f"{where}: {first['msg']}" if where else first["msg"]
        raise ResultError(f"{path} is truncated, damaged or of another version: {said}") from error
    if _written(result) != text:
        raise ResultError(f"{path} was changed, or is of another version: it is not as we write it")
    return result


def _written(result: RunResult) -> str:
    """Return a result as we write it; empty for one with numbers that we do not write."""
    try:
        return to_json(result)
    except ValueError:
        return ""
