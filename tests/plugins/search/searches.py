"""A search whose flights take a second or two, and an engine that flies nothing."""

from collections.abc import Callable, Mapping
from pathlib import Path

from tests.orchestrator.hover import write_hover
from wil_campaign.campaigns.expansion.expansion import Campaign, RunPlan
from wil_campaign.orchestrator.run_results.run_result import RunResult, Stop, SyncResult
from wil_campaign.plugins.search.engine import EngineResult
from wil_campaign.safety.model.oracle_results import OracleResult, Verdict

LIMIT_M = 1.3
SEARCH = """\
search:
  parameters:
    height: {key: goal.altitude_m, from: 0.8, to: 2.0, steps: 3}
  objective: altitude
  strategy: grid
  budget: {sim: 3}
  confirm: {flights: 2, most: 1}
  reduce: 4
"""


def write_search(folder: Path, search: str = SEARCH) -> Path:
    """Write a campaign that fails where it flies higher than 1.3 m, with a search for that."""
    path = write_hover(folder)
    oracles = f"oracles: {{landed: {{}}, altitude: {{max_m: {LIMIT_M}}}}}"
    path.write_text(path.read_text().replace("oracles: {landed: {}}", oracles) + search)
    return path


class MadeUpEngine:
    """Flies nothing: each run comes to what its altitude says. flown: runs, in their order.

    code: digests of what its flights import, by path.
    """

    def __init__(
        self,
        *,
        before: Callable[[int], None] = lambda _: None,
        stopped: Callable[[int], Stop | None] = lambda _: None,
        verdict: Callable[[float], Verdict] = lambda margin_m: "FAIL" if margin_m < 0.0 else "PASS",
        code: Mapping[str, str] | None = None,
        is_broken: bool = False,
    ) -> None:
        self._code = code or {}
        self.flown: list[str] = []
        self._before = before
        self._stopped = stopped
        self._verdict = verdict
        self._is_broken = is_broken
        self._batches = 0

    def fly(self, campaign: Campaign, folder: Path) -> EngineResult:
        """Return made-up results of a batch; `before` may raise as a kill would end it."""
        self._batches += 1
        self._before(self._batches)
        if (stopped := self._stopped(self._batches)) is not None:
            return EngineResult(runs={}, stopped=stopped)
        names = [f"{folder.name}/{plan.name}" for plan in campaign.runs]
        self.flown += names
        runs = {plan.name: self._result(plan) for plan in campaign.runs}
        return EngineResult(runs=runs, is_broken=self._is_broken)

    def _result(self, plan: RunPlan) -> RunResult:
        height_m = plan.files.campaign.get(("goal", "altitude_m"))
        assert isinstance(height_m, int | float)
        margin_m = LIMIT_M - height_m
        verdict = self._verdict(margin_m)
        return RunResult(
            case=plan.case,
            mode=plan.mode,
            rep=plan.repetition,
            seed=plan.seed,
            verdict=verdict,
            reason="twin is too high" if verdict == "FAIL" else "",
            also=(),
            required=False,
            duration_s=10.0,
            wall_s=1.0,
            oracles=(
                OracleResult(
                    "altitude", "twin", True, "PASS", height_m, LIMIT_M, "m", margin_m, 1.0
                ),
            ),
            sync=SyncResult(),
            mixing=None,
            decided_by="altitude/twin" if verdict == "FAIL" else "",
            code=self._code,
        )
