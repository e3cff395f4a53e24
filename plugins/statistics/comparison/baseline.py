"""Baseline flights of a comparison: of one results folder, or of the last ones beneath a folder."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from wil_campaign.foundation.files.documents import Data
from wil_campaign.orchestrator.reading.errors import ResultsFolderError
from wil_campaign.orchestrator.reading.model import CampaignDocuments
from wil_campaign.orchestrator.reading.results_folder import read_campaign_documents
from wil_campaign.orchestrator.run_results.control_results import control_faults
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.plugins.statistics.comparison.errors import ComparisonError

_DOCUMENTS = ("campaign.json", "summary.json")
"""A results folder has at least one of them, unless both were lost."""
_LEDGER = "ledger.jsonl"
_LONGEST_FIRST_LINE = 1000
"""In characters; the ledger of a campaign on a cluster has the same file name as a search's."""


@dataclass(frozen=True, slots=True)
class FlownSet:
    """Flights of one or several results folders, in the order of `folders`."""

    folders: tuple[Path, ...]
    campaigns: tuple[CampaignDocuments, ...]

    @property
    def runs(self) -> list[RunResult]:
        """Return all runs that have a result."""
        return [
            entry.result
            for campaign in self.campaigns
            for entry in campaign.entries
            if entry.result is not None
        ]

    @property
    def problems(self) -> list[str]:
        """Return what is missing or damaged, each with its folder."""
        return [
            f"{folder}: {text}"
            for folder, campaign in zip(self.folders, self.campaigns, strict=True)
            for text in (*campaign.problems, *campaign.run_problems)
        ]

    @property
    def endings(self) -> list[str]:
        """Return why campaigns ended early, each with its folder."""
        return [
            f"{folder}: {campaign.summary.ending}"
            for folder, campaign in zip(self.folders, self.campaigns, strict=True)
            if campaign.summary is not None and campaign.summary.ending
        ]

    @property
    def names(self) -> list[str]:
        """Return the names of the folders, or their paths where two have the same name."""
        names = [folder.name for folder in self.folders]
        return names if len({*names}) == len(names) else [str(folder) for folder in self.folders]

    @property
    def manifests(self) -> dict[str, Mapping[str, Data]]:
        """Return the manifests that could be read, by the names of their folders."""
        return {
            name: campaign.manifest
            for name, campaign in zip(self.names, self.campaigns, strict=True)
            if campaign.manifest
        }

    @property
    def runs_by_folder(self) -> dict[str, list[RunResult]]:
        """Return the runs that have a result, by the names of their folders."""
        return {
            name: [entry.result for entry in campaign.entries if entry.result is not None]
            for name, campaign in zip(self.names, self.campaigns, strict=True)
        }

    @property
    def controls(self) -> list[str]:
        """Return the controls that have a result, as "case/mode", each once."""
        controls = (run for run in self.runs if run.control is not None)
        return list(dict.fromkeys(f"{run.case}/{run.mode}" for run in controls))

    @property
    def unmet(self) -> list[str]:
        """Return which controls did not end as expected, each with its folder."""
        return [
            f"{folder}: {text}"
            for folder, campaign in zip(self.folders, self.campaigns, strict=True)
            for text in control_faults(entry.result for entry in campaign.entries if entry.result)
        ]


def read_flown(folder: Path) -> FlownSet:
    """Return the flights of one results folder. Raises ResultsFolderError."""
    return FlownSet((folder,), (read_campaign_documents(folder),))


def read_baseline(folder: Path, *, last: int, before: Path) -> FlownSet:
    """Return the flights of a results folder, or of the last ones beneath it before another.

    last: the largest number of results folders of the campaign of `before`, newest by start time;
    `before` itself is excluded. Raises ResultsFolderError, ComparisonError.
    """
    if is_results_folder(folder) or not folder.is_dir():
        return read_flown(folder)
    judged = read_campaign_documents(before)
    limit = _started(judged) or "~"
    folders = results_folders(folder)
    campaigns = [
        (path, campaign)
        for path in folders
        if path.resolve() != before.resolve()
        if (campaign := _readable(path)) is not None and campaign.name == judged.name
        if (_started(campaign) or "") < limit
    ]
    campaigns.sort(key=lambda pair: _started(pair[1]) or "")
    if not folders:
        raise ResultsFolderError(
            f"{folder} is not the results folder of a campaign, and contains none"
        )
    if not campaigns:
        raise ComparisonError(
            f"{folder} contains no campaign '{judged.name}' that was flown before {before}"
        )
    chosen: Sequence[tuple[Path, CampaignDocuments]] = campaigns[-last:]
    return FlownSet(tuple(path for path, _ in chosen), tuple(documents for _, documents in chosen))


def results_folders(folder: Path) -> list[Path]:
    """Return the results folders at or beneath a folder, three levels deep at most.

    Those of searches are left out, with what was flown for them; each is there once, with symlinks.
    """
    found = {
        path.parent
        for depth in range(4)
        for name in _DOCUMENTS
        for path in folder.glob("*/" * depth + name)
    }
    found = {*{path.resolve(): path for path in sorted(found, reverse=True)}.values()}
    searches = [path for path in found if _is_of_search(path)]
    return sorted(
        path for path in found if not any(path.is_relative_to(search) for search in searches)
    )


def is_results_folder(folder: Path) -> bool:
    """Return whether a folder is that of one campaign."""
    return any((folder / name).is_file() for name in _DOCUMENTS)


def _readable(path: Path) -> CampaignDocuments | None:
    try:
        return read_campaign_documents(path)
    except ResultsFolderError:
        return None


def _started(documents: CampaignDocuments) -> str | None:
    started = documents.manifest.get("started_utc")
    return started if isinstance(started, str) else None


def _is_of_search(folder: Path) -> bool:
    """Return whether a folder is that of a search: its ledger begins like that of a search."""
    try:
        with (folder / _LEDGER).open(encoding="utf-8") as stream:
            first = json.loads(stream.readline(_LONGEST_FIRST_LINE))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(first, dict) and "at_once" in first
