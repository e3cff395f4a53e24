"""Writes the report at the end of `run`; its failure leaves the results as is."""

from collections.abc import Sequence
from pathlib import Path

from wil_campaign.foundation.files.problems import printable_problem
from wil_campaign.orchestrator.cli.standard_streams import write_stderr
from wil_campaign.orchestrator.report import campaign_report

_SHOWN = 10


def write_final_report(folder: Path) -> campaign_report.WrittenReport | None:
    """Write the report of a campaign that was just flown, and return where it is.

    None where it was not written: a line on standard error says why.
    """
    try:
        return campaign_report.write_report(folder)
    except KeyboardInterrupt:
        why = "interrupted"
    except (Exception, SystemExit) as error:  # noqa: BLE001 - the results are whole
        why = f"{type(error).__name__}: {error}"
    write_stderr(
        f"ERROR: {campaign_report.FILE_NAME} was not written ({why}); the results are complete "
        f"without it, and `wil-campaign report {folder}` writes it"
    )
    return None


def name_problems(problems: Sequence[str]) -> None:
    """Write what a report lacks to standard error, the first of it."""
    for text in problems[:_SHOWN]:
        write_stderr(printable_problem(text))
    more = len(problems) - _SHOWN
    if more > 0:
        write_stderr(f"and {more} more, which the report names")
