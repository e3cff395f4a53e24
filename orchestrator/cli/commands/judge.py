"""`wil-campaign judge`: judges recorded runs again by the present campaign file."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from wil_campaign.campaigns.expansion.expansion import load_campaign
from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.orchestrator.campaign.reevaluation import Reevaluation, judge_campaign_again
from wil_campaign.orchestrator.cli.announcements import announce_verdicts
from wil_campaign.orchestrator.cli.run_selection import ALL, RunSelection
from wil_campaign.orchestrator.cli.standard_streams import write_stderr, write_stdout
from wil_campaign.orchestrator.cli.text_table import table_lines
from wil_campaign.orchestrator.cli.verdict_table import closing_lines
from wil_campaign.orchestrator.recording.errors import RecordingError


def judge(
    file: Path,
    folder: Path,
    *,
    choice: RunSelection = ALL,
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """Judge recorded runs again, by the oracles that the campaign file has now; fly nothing.

    Neither the autonomy nor a step of the recipe is loaded: only this program's code runs.

    The last line and the exit code are those of `run`: a required run that is not in the folder was
    not flown, and then the code is 3, whatever share of the runs may fail. The last line names
    options and files that differ from those of the flight; another world is refused.

    Parameters
    ----------
    file
        The campaign file.
    folder
        The results folder of a campaign: DIR/<campaign>/<UTC start>. Nothing in it is changed.
    json_
        Print one JSON document: summary.json as it is judged now, and changed_since_flight.
    """
    options = replace(choice.options(), is_autonomy_isolated=False, loads_code=False)
    campaign = load_campaign(file, options)
    try:
        judgement = judge_campaign_again(campaign, folder)
    except RecordingError as error:
        write_stderr(error)
        return 3
    if json_:
        document = {
            **asdict(judgement.summary),
            "changed_since_flight": judgement.changed_since_flight,
        }
        write_stdout(to_json(document).rstrip())
    else:
        rows = [_row(each) for each in judgement.runs]
        write_stdout(table_lines(("run", "flown", "now", "reason"), rows))
        for change in _changes(judgement.runs):
            write_stdout(change)
        for line in closing_lines(
            judgement.summary,
            campaign.requirements,
            changed_since_flight=judgement.changed_since_flight,
        ):
            write_stdout(line.plain)
    announce_verdicts(campaign, judgement.summary, folder)
    return judgement.exit_code


def _row(each: Reevaluation) -> tuple[str, str, str, str]:
    """Return the table row of a run judged again."""
    run = each.now
    return (f"{run.case}/{run.mode}/{run.rep}", each.before.verdict, run.verdict, run.reason)


def _changes(rejudged: tuple[Reevaluation, ...]) -> list[str]:
    """Return a line for each oracle that judges differently now."""
    lines = []
    for each in rejudged:
        before = {(oracle.name, oracle.vehicle): oracle for oracle in each.before.oracles}
        for now in each.now.oracles:
            then = before.get((now.name, now.vehicle))
            if then is None or then.verdict != now.verdict:
                was = "not judged" if then is None else then.verdict
                run = f"{now.name} of {now.vehicle} in {_row(each)[0]}"
                lines.append(f"{run}: {now.verdict} (was {was})")
    return lines
