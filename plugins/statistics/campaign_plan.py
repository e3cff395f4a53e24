"""The plan of a campaign: its runs and controls, what it requires, the flights that claims need."""

from dataclasses import asdict
from pathlib import Path

from wil_campaign.campaigns.expansion.expansion import Campaign, load_campaign
from wil_campaign.campaigns.values.acceptance import PassRequirement
from wil_campaign.orchestrator.cli.run_selection import ALL
from wil_campaign.plugins.statistics.proportions import flights_without_failure

CLAIMS = (0.80, 0.90, 0.95, 0.99)
"""Pass rates for which the plan states how many flights without a failure show them."""


def plan(campaign: Campaign | str | Path) -> dict[str, object]:
    """Return what `wil-campaign plan --json` prints of a loaded campaign, or of a file.

    Its runs and controls with their seeds, what it requires, and the flights that claims need.
    Raises BadInput.
    """
    if not isinstance(campaign, Campaign):
        campaign = load_campaign(Path(campaign), ALL.options())
    return plan_document(campaign)


def plan_document(campaign: Campaign) -> dict[str, object]:
    """Return the plan as the document of --json."""
    return {
        "campaign": campaign.name,
        "seed": campaign.seed,
        "runs": [
            {
                "case": run.case,
                "mode": run.mode,
                "rep": run.repetition,
                "seed": run.seed,
                "required": run.required,
            }
            for run in campaign.runs
        ],
        "controls": [
            {
                "control": run.case,
                "case": run.control.case,
                "mode": run.mode,
                "seed": run.seed,
                "verdict": run.control.verdict,
                "oracle": run.control.oracle,
                "cause": run.control.cause,
            }
            for run in campaign.controls
            if run.control is not None
        ],
        "claims": [
            {"pass_rate": rate, "confidence": 0.95, "flights": flights_without_failure(rate)}
            for rate in CLAIMS
        ],
        "accept": [_accept_entry(requirement) for requirement in campaign.requirements],
    }


def _accept_entry(wanted: PassRequirement) -> dict[str, object]:
    """Return what is required of a case and mode: the share, or the test that has to decide."""
    entry: dict[str, object] = {"case": wanted.case, "mode": wanted.mode}
    if wanted.test is not None:
        return entry | {"test": asdict(wanted.test)}
    return entry | {"passes": wanted.share.passes, "runs": wanted.share.runs}
