"""The tables of a campaign's results."""

from dataclasses import replace
from pathlib import Path

from tests.orchestrator.run_results.test_results import result
from wil_campaign.orchestrator.run_results.campaign_results import summarize
from wil_campaign.plugins.python.campaign_results import CampaignResults
from wil_campaign.safety.model.oracle_results import OracleResult

LIMITS = (
    (OracleResult("clearance", "twin", True, "PASS", 0.4, 0.3, "m", 0.1, 3.0), (0.3, None)),
    (OracleResult("clearance", "twin", True, "PASS", None, 0.3, "m", None, None), (0.3, None)),
    (OracleResult("collision", "twin", True, "FAIL", 0.0, 0.0, "m", 0.0, 3.0), (0.0, None)),
    (OracleResult("collision", "twin", True, "PASS", 0.4, 0.0, "m", 0.4, 3.0), (0.0, None)),
    (OracleResult("time_limit", "twin", True, "FAIL", None, 40.0, "s", None, None), (None, 40.0)),
    (OracleResult("modes", "twin", True, "PASS", 0.0, 0.0, "changes", 0.0, None), (None, 0.0)),
    (OracleResult("altitude", "twin", True, "PASS", 1.0, (0.5, 2.0), "m", 0.5, 1.0), (0.5, 2.0)),
)


def test_a_limit_is_in_one_column_whatever_was_measured() -> None:
    oracles = tuple(oracle for oracle, _ in LIMITS)
    summary = summarize(
        [replace(result("PASS", 1), oracles=oracles)],
        [],
        campaign="gate",
        clock="virtual",
        surrogate=False,
        real_kind="embedded",
        sensors={},
    )
    rows = CampaignResults(folder=Path(), summary=summary).oracle_rows()
    assert [(row["limit_low"], row["limit_high"]) for row in rows] == [pair for _, pair in LIMITS]
