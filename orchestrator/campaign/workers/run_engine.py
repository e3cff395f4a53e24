"""Engines: where the runs of a campaign fly. An engine provides the workers of the worker pool."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from wil_campaign.campaigns.expansion.expansion import Campaign
from wil_campaign.orchestrator.campaign.workers.local_workers import LocalWorkers
from wil_campaign.orchestrator.campaign.workers.run_order import (
    completed_run,
    flies_processes,
    fly_order,
)
from wil_campaign.orchestrator.campaign.workers.run_workers import WorkerStarter
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_setup import RunOrder

LOCAL = "local"
"""The engine of this machine, as `--engine` names it."""


class EngineError(Exception):
    """An engine cannot fly: says why, and the remedy. code: the exit code of the program."""

    def __init__(self, text: str, code: int = 3) -> None:
        super().__init__(text)
        self.code = code


class RunEngine(Protocol):
    """Flies the runs of campaigns somewhere (protocol)."""

    @property
    def reads_files_here(self) -> bool:
        """Return whether each run reads the campaign's files on this machine anew."""

    def workers(
        self, campaign: Campaign, folder: Path, say: Callable[[str], None]
    ) -> WorkerStarter[RunOrder, RunResult]:
        """Return the workers of a campaign. folder: of its results, which exists.

        say: shows the user a sentence. Raises EngineError.
        """


@dataclass(frozen=True, slots=True)
class LocalRunEngine:
    """Flies runs in processes of this machine."""

    @property
    def reads_files_here(self) -> bool:
        """Return True."""
        return True

    def workers(
        self,
        campaign: Campaign,  # noqa: ARG002  # an order has all that its run needs
        folder: Path,  # noqa: ARG002
        say: Callable[[str], None],  # noqa: ARG002
    ) -> LocalWorkers[RunOrder, RunResult]:
        """Return worker processes, forked from the run server."""
        return LocalWorkers(fly_order, completed_run, flies_processes)
