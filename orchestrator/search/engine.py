"""The engine of a search: flies a batch of variants, and hands back what came of them."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from campaigns.expansion.expansion import Campaign
from orchestrator.campaign.campaign_runner import FlyingSettings, Watcher, fly_campaign
from orchestrator.model.clock import Clock
from orchestrator.model.results import RunResult, Stop, VehicleKind

_SIGNAL, _COMMAND, _BROKEN = 130, 4, 3
"""Exit codes of a flown campaign."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EngineResult:
    """What an engine hands back. runs: by their names, `<case>/<mode>/<rep>`.

    stopped: what ended the batch early. is_broken: an exception of ours was met.
    """

    runs: Mapping[str, RunResult]
    stopped: Stop | None = None
    is_broken: bool = False


class Engine(Protocol):
    """Flies campaigns for a search, each into a folder of its own."""

    def fly(self, campaign: Campaign, folder: Path) -> EngineResult:
        """Fly what is not flown yet of a campaign into its folder, and return all its results.

        Raises OutputError, OperatingError, ResumeError.
        """


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalEngine:
    """The engine of this machine: worker processes, as many at once as there are jobs."""

    clock: Clock
    jobs: int
    real_kind: VehicleKind
    watcher: Watcher

    def fly(self, campaign: Campaign, folder: Path) -> EngineResult:
        """Fly a batch's campaign; one that was cut off is resumed."""
        settings = FlyingSettings(
            out=folder,
            folder=folder,
            clock=self.clock,
            jobs=self.jobs,
            real_kind=self.real_kind,
            resume=(folder / "campaign.json").is_file(),
        )
        outcome = fly_campaign(campaign, settings, self.watcher)
        stops: dict[int, Stop] = {_SIGNAL: "signal", _COMMAND: "command"}
        return EngineResult(
            runs={f"{one.case}/{one.mode}/{one.rep}": one for one in outcome.summary.runs},
            stopped=stops.get(outcome.exit_code),
            is_broken=outcome.exit_code == _BROKEN,
        )
