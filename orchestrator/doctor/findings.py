"""What doctor finds: one line each, with what to do where something is to be done."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

Grade = Literal["good", "note", "trouble"]
MARKS: dict[Grade, str] = {"good": "ok", "note": "--", "trouble": "!!"}


@dataclass(frozen=True, slots=True)
class Finding:
    """A finding of the doctor: topic, severity, text, remedy.

    topic: under which it is told. grade: note for what only some campaigns need. remedy: what to
    do about it; empty where nothing is to be done.
    """

    topic: str
    grade: Grade
    text: str
    remedy: str = ""


def as_text(findings: Iterable[Finding]) -> str:
    """Return the doctor's findings as text, topic by topic."""
    lines: list[str] = []
    topic = ""
    for one in findings:
        if one.topic != topic:
            topic = one.topic
            lines += ([""] if lines else []) + [topic]
        lines.append(f"  {MARKS[one.grade]} {one.text}")
        if one.remedy:
            lines.append(f"     {one.remedy}")
    return "\n".join(lines)
