"""Warnings of `validate`: limits of these oracles that no flight of a case exceeds; pure."""

from collections.abc import Iterator
from typing import get_args

from wil_campaign.campaigns.schema import Mode
from wil_campaign.campaigns.setup.case_files import CaseFiles
from wil_campaign.campaigns.setup.case_setup import Case
from wil_campaign.foundation.files.documents import Document, Path, Problem
from wil_campaign.plugins.flight_oracles.autopilot_health import (
    BatteryParameters,
    EstimatorParameters,
    ModesParameters,
)
from wil_campaign.plugins.flight_oracles.motion import AttitudeParameters
from wil_campaign.safety.model.samples import ModeName

_STEEPEST_DEG = {"max_tilt_deg": 180.0, "max_roll_deg": 180.0, "max_pitch_deg": 90.0}
"""No attitude has a larger angle."""


def limit_hints(files: CaseFiles, case: Case, _: tuple[Mode, ...]) -> Iterator[Problem]:
    """Yield warnings for limits that no flight exceeds, in whatever mode and world."""
    file, sync = files.campaign, case.sync
    longest_s = sync.takeoff_timeout_s + sync.goal_timeout_s + sync.landing_timeout_s
    for use in case.oracles:
        path: Path = ("oracles", use.name)
        given = use.parameters
        if isinstance(given, BatteryParameters) and given.min_percent == 0.0:
            message = "no battery is charged to less than 0 %: it cannot fail"
            yield file.problem((*path, "min_percent"), message)
        elif isinstance(given, ModesParameters):
            if given.max_changes is None and set(given.allowed) >= set(get_args(ModeName)):
                yield file.problem((*path, "allowed"), "names every mode: it cannot fail")
        elif isinstance(given, AttitudeParameters):
            yield from _any_attitude(file, path, given)
        elif isinstance(given, EstimatorParameters) and given.max_unsound_s >= longest_s:
            message = f"the time-outs of `sync` end each flight after {longest_s:g} s"
            yield file.problem((*path, "max_unsound_s"), f"{message}: it cannot fail")


def _any_attitude(file: Document, path: Path, given: AttitudeParameters) -> Iterator[Problem]:
    for key, steepest_deg in _STEEPEST_DEG.items():
        limit_deg = getattr(given, key)
        if limit_deg is not None and limit_deg >= steepest_deg:
            message = f"no attitude is beyond {steepest_deg:g} degrees: it cannot fail"
            yield file.problem((*path, key), message)
