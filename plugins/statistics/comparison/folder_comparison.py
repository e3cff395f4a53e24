"""Compares the campaigns of results folders: flights, controls, settings and firmware."""

from dataclasses import dataclass
from pathlib import Path

from wil_campaign.plugins.statistics.comparison.baseline import (
    FlownSet,
    read_baseline,
    read_flown,
)
from wil_campaign.plugins.statistics.comparison.comparison import (
    FlightComparison,
    LossLimits,
    runs_by_cell,
)
from wil_campaign.plugins.statistics.comparison.comparison import (
    compare_flown_sets as compare_flights,
)
from wil_campaign.plugins.statistics.comparison.settings import (
    SettingsChanges,
    firmware_changes_since,
    settings_changes,
)


@dataclass(frozen=True, slots=True)
class FolderComparison:
    """The comparison of a campaign with earlier ones.

    found: its flights with theirs. baseline, judged: what was read. removed_controls: "case/mode"
    of controls that only the baseline has. settings: how limits, worlds, files and firmware differ.
    level: the largest p that is beyond chance.
    """

    found: FlightComparison
    baseline: FlownSet
    judged: FlownSet
    removed_controls: tuple[str, ...]
    settings: SettingsChanges
    level: float

    @property
    def is_less(self) -> bool:
        """Return whether less is judged now than before."""
        return self.found.is_less or bool(self.removed_controls or self.settings.removed)

    @property
    def problems(self) -> tuple[str, ...]:
        """Return what is damaged, ended early, or was not caught by a control; with its folder."""
        before, now = self.baseline, self.judged
        damaged = (*before.problems, *now.problems)
        return (*damaged, *before.endings, *before.unmet, *now.endings, *now.unmet)

    def exit_code(self, *, removed: bool = False, changed: bool = False) -> int:
        """Return the exit code of `wil-campaign compare`: 0, 1 (worse), 3 (shows nothing).

        removed, changed: whether less than before, or other settings, are accepted.
        """
        found, now = self.found, self.judged
        if self.baseline.problems or now.problems or now.endings or now.unmet:
            return 3
        if found.unproven or found.fewer_proven:
            return 3
        if (self.is_less and not removed) or (self.settings.changed and not changed):
            return 3
        return 1 if found.worse else 3 if found.untestable else 0


def compare(
    before: str | Path,
    after: str | Path,
    *,
    worse_by: float = 0.1,
    margin_by: float | None = None,
    confidence: float = 0.95,
    last: int = 5,
) -> FolderComparison:
    """Return how the campaign of one results folder differs from one, or some, before it.

    before: a results folder, or a folder of several, of which the `last` ones before `after` of its
    campaign are the baseline together. worse_by: the loss of pass rate that counts, from 0 to 1.
    margin_by: the loss of an oracle's margin that counts, in its unit; None: margins are not
    compared. confidence: of all tests together.

    Raises ResultsFolderError, ComparisonError, ValueError for a number out of range.
    """
    if not (0 <= worse_by <= 1 and 0 < confidence < 1 and last >= 1):
        raise ValueError("worse_by is 0 to 1, confidence between 0 and 1, last 1 or more")
    if margin_by is not None and not margin_by > 0:
        raise ValueError("margin_by is larger than 0")
    judged = read_flown(Path(after))
    baseline = read_baseline(Path(before), last=last, before=Path(after))
    limits = LossLimits(worse_by, margin_by, confidence)
    found = compare_flights(runs_by_cell(baseline.runs), runs_by_cell(judged.runs), limits)
    gone = tuple(control for control in baseline.controls if control not in judged.controls)
    settings = _settings(baseline, judged)
    return FolderComparison(found, baseline, judged, gone, settings, limits.level)


def _settings(baseline: FlownSet, judged: FlownSet) -> SettingsChanges:
    """Return how the settings differ; nothing where a manifest cannot be read, a problem itself."""
    (now,) = judged.manifests.values() or ({},)
    firmware = firmware_changes_since(baseline.runs_by_folder, judged.runs)
    return (settings_changes(baseline.manifests, now) if now else SettingsChanges()) + firmware
