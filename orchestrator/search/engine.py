"""The engine of a search: flies a batch of variants, and returns their results."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from campaigns.expansion.expansion import Campaign
from orchestrator.campaign.campaign_runner import FlyingSettings, Watcher, fly_campaign
from orchestrator.campaign.workers.run_engine import LocalRunEngine, RunEngine
from orchestrator.model.campaign_results import VehicleKind
from orchestrator.model.clock import Clock
from orchestrator.model.results import RunResult, Stop

_SIGNAL, _COMMAND, _BROKEN = 130, 4, 3
"""Exit codes of a flown campaign."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EngineResult:
    """The results of a batch. runs: by their names, `<case>/<mode>/<rep>`.

    stopped: what ended the batch early. is_broken: there was an internal error.
    """

    runs: Mapping[str, RunResult]
    stopped: Stop | None = None
    is_broken: bool = False


class Engine(Protocol):
    """Flies campaigns for a search, each into its own folder (protocol)."""

    def fly(self, campaign: Campaign, folder: Path) -> EngineResult:
        """Fly the remaining runs of a campaign into its folder, and return all its results.

        Raises OutputError, OperatingError, ResumeError, EngineError.
        """


@dataclass(frozen=True, slots=True, kw_only=True)
class BatchEngine:
    """Flies each batch as a campaign. runs: where its runs fly; jobs: how many at once."""

    clock: Clock
    jobs: int
    real_kind: VehicleKind
    watcher: Watcher
    runs: RunEngine = field(default_factory=LocalRunEngine)

    def fly(self, campaign: Campaign, folder: Path) -> EngineResult:
        """Fly a batch's campaign, or resume it."""
        settings = FlyingSettings(
            out=folder,
            folder=folder,
            clock=self.clock,
            jobs=self.jobs,
            real_kind=self.real_kind,
            engine=self.runs,
            resume=(folder / "campaign.json").is_file(),
            repeats_cut_off=True,
        )
        outcome = fly_campaign(campaign, settings, self.watcher)
        stops: dict[int, Stop] = {_SIGNAL: "signal", _COMMAND: "command"}
        return EngineResult(
            runs={f"{one.case}/{one.mode}/{one.rep}": one for one in outcome.summary.runs},
            stopped=stops.get(outcome.exit_code),
            is_broken=outcome.exit_code == _BROKEN,
        )
