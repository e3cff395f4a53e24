"""World-in-the-loop campaigns from Python: load, validate, fly, and read results.

    results = wil_campaign.run("campaigns/gate.yaml")
    assert results.accepted

The names in `__all__` are stable: none is removed or changes its meaning without an entry in the
changelog. docs/python.md has examples. An autonomy, which a campaign flies, imports
`campaigns.api` instead.
"""

from campaigns.expansion.expansion import Campaign, RunPlan
from orchestrator.analysis.errors import ResultsFolderError
from orchestrator.analysis.study import Study
from orchestrator.api.campaign_results import CampaignResults, read_results
from orchestrator.api.flying import CannotFlyError, run, run_async
from orchestrator.api.loading import load, validate
from orchestrator.api.mock_vehicle import MockVehicle, MockVehicleError, mock_vehicle
from orchestrator.model.campaign_results import Summary, Totals
from orchestrator.model.results import RunResult
from safety.model.oracle_results import OracleResult
from worlds.files.documents import BadInput, Problem

__all__ = [
    "BadInput",
    "Campaign",
    "CampaignResults",
    "CannotFlyError",
    "MockVehicle",
    "MockVehicleError",
    "OracleResult",
    "Problem",
    "ResultsFolderError",
    "RunPlan",
    "RunResult",
    "Study",
    "Summary",
    "Totals",
    "load",
    "mock_vehicle",
    "read_results",
    "run",
    "run_async",
    "validate",
]
