"""The report at the end of `run`: whatever becomes of it, the results stay as they are."""

from pathlib import Path

from orchestrator.cli.standard_streams import err
from orchestrator.report.campaign_report import FILE_NAME, WrittenReport, write_report


def write_final_report(folder: Path) -> WrittenReport | None:
    """Write the report of a campaign that was just flown, and return where it is.

    None where there is none: a line says why, and nothing else changes.
    """
    try:
        return write_report(folder)
    except KeyboardInterrupt:
        why = "interrupted"
    except Exception as error:  # noqa: BLE001 - the flights are over, and their results are whole
        why = f"{type(error).__name__}: {error}"
    err(
        f"ERROR: {FILE_NAME} was not written ({why}); the results are complete without it, and "
        f"`wil-campaign report {folder}` writes it"
    )
    return None
