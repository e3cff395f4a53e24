"""Findings of `wil-campaign doctor`, each with its remedy, and their text."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

Grade = Literal["good", "note", "trouble"]
CAMPAIGNS = "campaigns"
"""The topic of what campaign files name."""
MARKS: dict[Grade, str] = {"good": "ok", "note": "--", "trouble": "!!"}


@dataclass(frozen=True, slots=True)
class Finding:
    """A finding of the doctor.

    topic: its heading. grade: note for what only some campaigns need. remedy: empty where there is
    nothing to do.
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
