"""The statistics of a campaign as text: tables, and the sentences beneath them."""

from wil_campaign.foundation.files.problems import printable_problem
from wil_campaign.orchestrator.cli.text_table import table_lines
from wil_campaign.plugins.statistics.conclusions import study_conclusions
from wil_campaign.plugins.statistics.study import Study
from wil_campaign.plugins.statistics.study_tables import (
    StudyTable,
    energy_rows,
    gap_rows,
    result_rows,
    speed_rows,
    study_statements,
)


def study_text(study: Study) -> str:
    """Return the conclusions, then the tables of results and of the gap, and the tests."""
    lines = [
        printable_problem(f"{conclusion.kind}: {conclusion.text}")
        for conclusion in study_conclusions(study)
    ]
    parts = ["\n".join(lines), _text(result_rows(study))]
    if study.gap.figures:
        parts.append(_text(gap_rows(study)))
    if (energies := energy_rows(study)).rows:
        parts.append(f"with the spread of each mode taken into account:\n\n{_text(energies)}")
    if (speeds := speed_rows(study)).rows:
        parts.append(f"how fast moving objects were:\n\n{_text(speeds)}")
    parts.append("\n".join(printable_problem(text) for text in study_statements(study)))
    return "\n\n".join(part for part in parts if part)


def _text(rows: StudyTable) -> str:
    return table_lines(rows.head, rows.rows)
