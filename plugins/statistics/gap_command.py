"""`wil-campaign gap`: pass rates by mode and the gap between simulation and reality."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from wil_campaign.foundation.files.problems import printable_problem
from wil_campaign.orchestrator.cli.standard_streams import write_stderr, write_stdout
from wil_campaign.orchestrator.reading.errors import ResultsFolderError
from wil_campaign.orchestrator.reading.results_folder import read_campaign_documents
from wil_campaign.plugins.statistics.study import Study, study_json
from wil_campaign.plugins.statistics.study_text import study_text


def gap(
    folder: Path, *, json_: Annotated[bool, Parameter(name="--json", negative=())] = False
) -> int:
    """Print the statistics of a flown campaign by mode: pass rates, tests, and the gap.

    The gap is how far flights of `sim` and of `wil` are from flights of `real`. Exit code 2: the
    folder has no campaign, or the campaign has no flights of `real` beside another mode; 3:
    something is missing or damaged.

    Parameters
    ----------
    folder
        The results folder of a campaign: DIR/<campaign>/<UTC start>.
    json_
        Print statistics.json.
    """
    try:
        campaign = read_campaign_documents(folder)
    except ResultsFolderError as error:
        write_stderr(printable_problem(str(error)))
        return 2
    study = Study.read(folder, campaign)
    if json_:
        write_stdout(study_json(campaign, study).rstrip())
    else:
        write_stdout(study_text(study))
    problems = (*campaign.problems, *campaign.run_problems)
    for text in problems:
        write_stderr(printable_problem(text))
    if not study.gap.figures:
        write_stderr("there is no gap to measure: it needs flights of mode real, and of sim or wil")
    damaged = bool(problems or study.gap.left_out)
    return 3 if damaged else 0 if study.gap.figures else 2
