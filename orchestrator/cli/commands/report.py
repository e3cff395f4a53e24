"""`wil-campaign report`: writes the HTML report of a flown campaign."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from wil_campaign.foundation.files.document_writer import HTML, require_own_file
from wil_campaign.foundation.files.problems import printable_problem
from wil_campaign.hooks import report_images
from wil_campaign.orchestrator.cli.final_report import name_problems
from wil_campaign.orchestrator.cli.plugin_options import (
    NO_OPTIONS,
    PluginOptions,
    given_options,
    takes_options,
)
from wil_campaign.orchestrator.cli.standard_streams import write_stderr, write_stdout
from wil_campaign.orchestrator.reading.errors import ResultsFolderError
from wil_campaign.orchestrator.report.ordered_report import write_ordered_report


@takes_options(report_images, "pictures", bool)
def report(
    folder: Path,
    *,
    out_: Annotated[Path | None, Parameter(name="--out")] = None,
    video: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    pictures: PluginOptions = NO_OPTIONS,
    run: str = "",
) -> int:
    """Write the report of a campaign: one HTML page that needs no network and no other file.

    Missing or damaged parts are left out and named: then the exit code is 3, and 2 where the folder
    has no campaign, or no run of a name.

    Parameters
    ----------
    folder
        The results folder of a campaign: DIR/<campaign>/<UTC start>. It may be unfinished.
    out_
        The file to write; by default report.html in the folder, where links to videos lead.
    video
        A run whose mixed.mp4 is made of its recorded images first, as large/wil/1; `all` for every
        run. May be given several times.
    run
        The run of the picture, as large/wil/1; by default the failed run that decides, else a
        failed one, else the first of mode wil.
    """
    require_own_file(out_, HTML)
    try:
        written = write_ordered_report(
            folder,
            out=out_,
            videos=video,
            pictures=[*given_options(pictures)],
            run=run,
            workers=None,
        )
    except ResultsFolderError as error:
        write_stderr(printable_problem(str(error)))
        return 2
    except OSError as error:
        write_stderr(f"the report cannot be written: {error.strerror or error}")
        return 3
    name_problems(written.problems)
    for path in written.pictures:
        write_stdout(printable_problem(f"picture: {path}"))
    write_stdout(printable_problem(f"report: {written.path}"))
    return 3 if written.problems else 0
