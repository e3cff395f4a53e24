"""Measures the gap of a results folder."""

from collections.abc import Iterable
from pathlib import Path

from wil_campaign.orchestrator.reading.model import RunEntry
from wil_campaign.orchestrator.run_results.evidence_files import foreign_files
from wil_campaign.plugins.statistics.gap.gap import CampaignGap, measure_gap
from wil_campaign.plugins.statistics.gap.motion import MotionError, RunMotion, read_motion
from wil_campaign.plugins.statistics.pass_rates import is_proven


def read_gap(folder: Path, entries: Iterable[RunEntry]) -> CampaignGap:
    """Return the gap of a campaign's runs, with the runs that cannot be compared.

    Empty for a campaign that did not fly reality and another mode.
    """
    runs = [entry for entry in entries if entry.result is not None and entry.result.control is None]
    if "real" not in (modes := {entry.mode for entry in runs}) or len(modes) == 1:
        return CampaignGap()
    flights: dict[tuple[str, str], list[RunMotion]] = {}
    left_out: list[str] = []
    for entry in runs:
        if entry.result is None or not is_proven(entry.result):
            continue
        if foreign := foreign_files(folder / entry.name, entry.result.evidence_files):
            left_out.append(f"{entry.name}: {foreign[0]}")
            continue
        try:
            motion = read_motion(folder / entry.name, entry.result.subject, entry.result.seed)
        except MotionError as error:
            left_out.append(f"{entry.name}: {error}")
        else:
            flights.setdefault((entry.case, entry.mode), []).append(motion)
    return measure_gap(flights, left_out)
