"""The engine of a search: flies a batch of variants, and returns their results."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from wil_campaign.campaigns.expansion.expansion import Campaign
from wil_campaign.orchestrator.campaign.campaign_runner import fly_campaign
from wil_campaign.orchestrator.campaign.display_thread import ProgressDisplay
from wil_campaign.orchestrator.campaign.flight_options import ClearedCampaign, FlightOptions
from wil_campaign.orchestrator.campaign.resuming.attached_vehicles import attached_vehicles
from wil_campaign.orchestrator.cli.arming_consent import NotConfirmedError, clear_for_flight
from wil_campaign.orchestrator.run_results.run_result import RunResult, Stop

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


class SearchEngine(Protocol):
    """Flies campaigns for a search, each into its own folder (protocol)."""

    def fly(self, campaign: Campaign, folder: Path) -> EngineResult:
        """Fly the remaining runs of a campaign into its folder, and return all its results.

        Raises OutputError, OperatingError, ResumeError, EngineError.
        """


@dataclass(frozen=True, slots=True, kw_only=True)
class BatchEngine:
    """Flies each batch as a campaign. cleared: as what.

    asks: with what a person at the terminal is asked before each batch with an attached vehicle;
    None where nothing that is attached flies.
    """

    cleared: ClearedCampaign
    watcher: ProgressDisplay
    asks: FlightOptions | None = None

    def fly(self, campaign: Campaign, folder: Path) -> EngineResult:
        """Fly a batch's campaign, or resume it."""
        options = FlightOptions(resume=(folder / "campaign.json").is_file())
        cleared = self.cleared
        if self.asks is not None and attached_vehicles(campaign):
            try:
                cleared = self._ask(campaign, self.asks)
            except NotConfirmedError as error:
                self.watcher.say(f"{error}; the search ends")
                return EngineResult(runs={}, stopped="command")
        outcome = fly_campaign(campaign, options, cleared, self.watcher, batch=folder)
        runs = {f"{run.case}/{run.mode}/{run.rep}": run for run in outcome.summary.runs}
        stops: dict[int, Stop] = {_SIGNAL: "signal", _COMMAND: "command"}
        stopped = stops.get(outcome.exit_code)
        aborted = {name for name, run in runs.items() if run.verdict == "ABORTED"}
        if outcome.summary.stopped is None and not aborted & outcome.announced:
            # A real vehicle's flight that was cut off before is not flown again: it proves nothing.
            stopped = None
        return EngineResult(
            runs=runs,
            stopped=stopped,
            is_broken=outcome.exit_code == _BROKEN or bool(outcome.summary.broken),
        )

    def _ask(self, campaign: Campaign, options: FlightOptions) -> ClearedCampaign:
        """Return what a person has cleared the batch's flights to be flown as.

        Raises RefusedError; NotConfirmedError without consent.
        """
        self.watcher.say("bring the vehicles back to their starts; then consent to the next flight")
        self.watcher.settle()
        return clear_for_flight(campaign, options)
