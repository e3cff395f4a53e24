"""Arguments that are several values, where a program gives one text or path."""

from collections.abc import Iterable
from pathlib import Path
from typing import TypeVar, cast

T = TypeVar("T")


def as_several(values: Iterable[T]) -> tuple[T, ...]:
    """Return values; one text or path in place of several is one of them, not its letters."""
    return (cast("T", values),) if isinstance(values, str | Path) else tuple(values)
