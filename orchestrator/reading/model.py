"""The contents of results folders, as far as they are readable; values only.

Times are on the run clock, seconds; positions NED metres in the world's local frame.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from wil_campaign.campaigns.values.acceptance import PassRequirement
from wil_campaign.foundation.files.documents import Data
from wil_campaign.orchestrator.run_results.campaign_results import Summary
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.worlds.frames import Vec3


@dataclass(frozen=True, slots=True)
class CommandedState:
    """State of a vehicle and setpoint of its autonomy at one time; a row of trajectory.csv.

    position_ned_m: the estimate. setpoint_kind: "position" (m), "velocity" (m/s), or "".
    """

    t_s: float
    vehicle: str
    stage: str
    mode: str
    is_armed: bool
    position_ned_m: Vec3 | None
    velocity_ned_m_s: Vec3 | None
    truth_ned_m: Vec3 | None
    setpoint_kind: str
    setpoint: Vec3 | None
    setpoint_yaw_rad: float | None
    note: str


@dataclass(frozen=True, slots=True)
class RunEntry:
    """A run of a results folder, as far as the campaign's documents describe it."""

    name: str
    case: str
    mode: str
    rep: str
    result: RunResult | None
    problems: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignDocuments:
    """A campaign. summary, manifest: None and empty where they cannot be read.

    entries: its runs and controls in order. requirements: of its cases and modes, at the flight.
    problems: what is missing or unreadable.
    """

    name: str
    folder: str
    entries: tuple[RunEntry, ...]
    summary: Summary | None = None
    manifest: Mapping[str, Data] = field(default_factory=dict)
    requirements: tuple[PassRequirement, ...] = ()
    problems: tuple[str, ...] = ()

    @property
    def run_problems(self) -> tuple[str, ...]:
        """Return what is missing or unreadable in runs, each with the run's name."""
        return tuple(f"{entry.name}: {text}" for entry in self.entries for text in entry.problems)
