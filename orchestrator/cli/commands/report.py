"""`wil-campaign report`: writes the HTML report of a flown campaign."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from orchestrator.analysis.errors import ResultsFolderError
from orchestrator.cli.standard_streams import err, out
from orchestrator.report.campaign_report import WrittenReport, write_report
from worlds.files.problems import printable

_SHOWN = 10


def report(folder: Path, *, out_: Annotated[Path | None, Parameter(name="--out")] = None) -> int:
    """Write the report of a campaign: one HTML page that needs no network and no other file.

    Missing or damaged parts are left out and named: then the exit code is 3, and 2 where the folder
    has no campaign.

    Parameters
    ----------
    folder
        The results folder of a campaign: DIR/<campaign>/<UTC start>. It may be unfinished.
    out_
        The file to write; by default report.html in the folder, where links to videos lead.
    """
    try:
        written = write_report(folder, out=out_)
    except ResultsFolderError as error:
        err(printable(str(error)))
        return 2
    except OSError as error:
        err(f"the report cannot be written: {error.strerror or error}")
        return 3
    _name_problems(written)
    out(printable(f"report: {written.path}"))
    return 3 if written.problems else 0


def _name_problems(written: WrittenReport) -> None:
    for text in written.problems[:_SHOWN]:
        err(printable(text))
    more = len(written.problems) - _SHOWN
    if more > 0:
        err(f"and {more} more, which the report names")
