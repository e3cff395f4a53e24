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


def findings_text(findings: Iterable[Finding]) -> str:
    """Return the doctor's findings as text, topic by topic."""
    lines: list[str] = []
    topic = ""
    for finding in findings:
        if finding.topic != topic:
            topic = finding.topic
            lines += ([""] if lines else []) + [topic]
        lines.append(f"  {MARKS[finding.grade]} {finding.text}")
        if finding.remedy:
            lines.append(f"     {finding.remedy}")
    return "\n".join(lines)
