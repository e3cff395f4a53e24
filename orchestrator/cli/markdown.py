"""Markdown of GitHub and GitLab: tables and lines with texts of runs, which stay texts."""

import re
from collections.abc import Sequence

from wil_campaign.foundation.files.problems import printable_problem

_MARKS = re.compile(r"([\\`*_{}\[\]<>|~])")
_CALLS = re.compile(r"([@#!])(?=\w)")
"""What would call a person or name an issue where the text is published."""
_APART = "\u200b"


def markdown_text(text: str) -> str:
    """Return a text as one line of Markdown that shows it, and neither formats nor calls."""
    return _CALLS.sub(rf"\1{_APART}", _MARKS.sub(r"\\\1", printable_problem(text)))


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table. header, rows: texts, which are escaped."""
    lines = [header, ["---"] * len(header), *rows]
    cells = ([markdown_text(cell) for cell in line] for line in lines)
    return "\n".join(f"| {' | '.join(line)} |" for line in cells)
