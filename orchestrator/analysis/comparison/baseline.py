"""Baseline flights of a comparison: of one results folder, or of the last ones beneath a folder."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from orchestrator.analysis.errors import ComparisonError, ResultsFolderError
from orchestrator.analysis.model import CampaignDocuments
from orchestrator.analysis.reading.results_folder import read_campaign
from orchestrator.model.control_results import control_faults
from orchestrator.model.results import RunResult
from orchestrator.search.ledger import is_search_folder

_DOCUMENTS = ("campaign.json", "summary.json")
"""A results folder has at least one of them, unless both were lost."""


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
    def unmet(self) -> list[str]:
        """Return which controls did not end as expected, each with its folder."""
        return [
            f"{folder}: {text}"
            for folder, campaign in zip(self.folders, self.campaigns, strict=True)
            for text in control_faults(one.result for one in campaign.entries if one.result)
        ]


def read_flown(folder: Path) -> FlownSet:
    """Return the flights of one results folder. Raises ResultsFolderError."""
    return FlownSet((folder,), (read_campaign(folder),))


def read_baseline(folder: Path, *, last: int, before: Path) -> FlownSet:
    """Return the flights of a results folder, or of the last ones beneath it before another.

    last: the largest number of results folders of the campaign of `before`, newest by start time;
    `before` itself is excluded. Raises ResultsFolderError, ComparisonError.
    """
    if is_results_folder(folder) or not folder.is_dir():
        return read_flown(folder)
    judged = read_campaign(before)
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
    return FlownSet(tuple(path for path, _ in chosen), tuple(one for _, one in chosen))


def results_folders(folder: Path) -> list[Path]:
    """Return the results folders at or beneath a folder, three levels deep at most.

    Those of searches are left out, with what was flown for them.
    """
    found = {
        path.parent
        for depth in range(4)
        for name in _DOCUMENTS
        for path in folder.glob("*/" * depth + name)
    }
    searches = [path for path in found if is_search_folder(path)]
    return sorted(
        path for path in found if not any(path.is_relative_to(search) for search in searches)
    )


def is_results_folder(folder: Path) -> bool:
    """Return whether a folder is that of one campaign."""
    return any((folder / name).is_file() for name in _DOCUMENTS)


def _readable(path: Path) -> CampaignDocuments | None:
    try:
        return read_campaign(path)
    except ResultsFolderError:
        return None


def _started(campaign: CampaignDocuments) -> str | None:
    started = campaign.manifest.get("started_utc")
    return started if isinstance(started, str) else None
