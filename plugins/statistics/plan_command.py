"""`wil-campaign plan`: shows the runs of a campaign."""

import json
import math
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from wil_campaign.campaigns.expansion.expansion import Campaign, load_campaign
from wil_campaign.orchestrator.cli.run_selection import ALL, RunSelection
from wil_campaign.orchestrator.cli.standard_streams import write_stdout
from wil_campaign.orchestrator.cli.text_table import count_text, table_lines
from wil_campaign.plugins.statistics.campaign_plan import CLAIMS, plan_document
from wil_campaign.plugins.statistics.proportions import flights_without_failure, least_pass_rate


def plan(
    file: Path,
    *,
    choice: RunSelection = ALL,
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """Show the runs of a campaign; nothing flies.

    Parameters
    ----------
    file
        The campaign file.
    json_
        Print one JSON document.
    """
    campaign = load_campaign(file, choice.options())
    document = plan_document(campaign)
    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)
    write_stdout(text if json_ else _as_table(campaign))
    return 0


def _as_table(campaign: Campaign) -> str:
    """Return the planned runs as a table."""
    rows = [
        (run.case, run.mode, run.repetition, run.seed, "required" if run.required else "reported")
        for run in campaign.runs
    ]
    rows += [
        (run.case, run.mode, run.repetition, run.seed, f"control: {run.control}")
        for run in campaign.controls
    ]
    wanted = [f"{r.case}/{r.mode} {r}" for r in campaign.requirements]
    accepted = ", ".join(wanted) if wanted else "nothing is required"
    shown = table_lines(("case", "mode", "rep", "seed", "counts"), rows)
    head = f"{campaign.name}: {_runs_text(campaign)}; accepted: {accepted}"
    return f"{head}\n\n{shown}\n\n{_claim_text(campaign)}"


def _claim_text(campaign: Campaign) -> str:
    """Return the strongest claim that the flights can show, and the flights for stronger ones."""
    repetitions = campaign.repetitions
    if (test := campaign.test) is not None:
        return (
            f"claims: a case and mode is flown until a pass rate of {test.at_least:g} is decided "
            f"against {test.against:g}, each with an error of {test.error:g}: {test.least_flights} "
            f"flights when all pass, {test.least_failures} when all fail, {test.most} at most"
        )
    # Rounded down: 58 flights show 0.9497, and no 0.95.
    shown = math.floor(100.0 * least_pass_rate(repetitions)) / 100.0
    needs = ", ".join(f"{rate:.2f} needs {flights_without_failure(rate)}" for rate in CLAIMS)
    return (
        f"claims: {count_text(repetitions, 'flight')} of a case and mode, all passed, show a pass "
        f"rate of at least {shown:.2f} with a confidence of 95 %; {needs}"
    )


def _runs_text(campaign: Campaign) -> str:
    """Return the number of planned runs and controls in words."""
    count = len(campaign.controls)
    controls = f" and {count_text(count, 'control')}" if count else ""
    return f"{len(campaign.runs)} runs{controls}"
