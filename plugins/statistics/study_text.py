"""The statistics of a campaign as text: tables, and the sentences beneath them."""

from wil_campaign.foundation.files.problems import printable
from wil_campaign.orchestrator.cli.text_table import table
from wil_campaign.plugins.statistics.conclusions import conclusions
from wil_campaign.plugins.statistics.study import Study
from wil_campaign.plugins.statistics.study_tables import (
    Rows,
    energy_rows,
    gap_rows,
    result_rows,
    speed_rows,
    statements,
)


def study_text(study: Study) -> str:
    """Return the conclusions, then the tables of results and of the gap, and the tests."""
    lines = [
        printable(f"{conclusion.kind}: {conclusion.text}") for conclusion in conclusions(study)
    ]
    parts = ["\n".join(lines), _text(result_rows(study))]
    if study.gap.figures:
        parts.append(_text(gap_rows(study)))
    if (energies := energy_rows(study)).rows:
        parts.append(f"with the spread of each mode taken into account:\n\n{_text(energies)}")
    if (speeds := speed_rows(study)).rows:
        parts.append(f"how fast moving objects were:\n\n{_text(speeds)}")
    parts.append("\n".join(printable(text) for text in statements(study)))
    return "\n\n".join(part for part in parts if part)


def _text(rows: Rows) -> str:
    return table(rows.head, rows.rows)
