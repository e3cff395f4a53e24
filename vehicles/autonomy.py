"""The interface of the autonomy under test: it gets readings and a goal, and returns setpoints.

One instance flies one vehicle. It gets mixed readings and its own vehicle's telemetry and nothing
else: never a scene, never the other vehicle. It is pure in this sense: its commands depend only on
its inputs, its parameters and its seed.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from wil_campaign.vehicles.readings import Reading
from wil_campaign.vehicles.setpoints import Setpoint
from wil_campaign.worlds.frames import Pose, Vec3


@dataclass(frozen=True, slots=True)
class Telemetry:
    """The telemetry that an autonomy gets: the vehicle's own estimate, world frame."""

    t_s: float
    pose: Pose
    velocity_ned_m_s: Vec3


@dataclass(frozen=True, slots=True)
class Command:
    """The autonomy's command for now; `done`: it considers its goal reached.

    `note` is a short word for the record ("search", "approach", "through"), shown to people.
    """

    setpoint: Setpoint
    done: bool = False
    note: str = ""


@runtime_checkable
class Autonomy(Protocol):
    """An autonomy under test; built as `factory(goal=..., parameters=..., seed=...)` per run."""

    def perceive(self, reading: Reading) -> None:
        """Give the autonomy a new (mixed) reading, in order of delivery.

        `reading.sensor` is the name of its sensor in the recipe.
        """

    def act(self, telemetry: Telemetry) -> Command:
        """Return the autonomy's command for now; called at the campaign's control rate."""


@runtime_checkable
class PerceivesRaw(Protocol):
    """An autonomy that also takes its mixtures' inputs, where a recipe publishes them."""

    def perceive_raw(self, reading: Reading) -> None:
        """Give the autonomy a reading of real or twin, just before its mixture."""


class AutonomyFactory(Protocol):
    """Builds an autonomy: a class with this constructor, or a function."""

    def __call__(
        self, *, goal: Mapping[str, float | str], parameters: Mapping[str, object], seed: int
    ) -> Autonomy:
        """Return a new autonomy. Raises ValueError on unknown parameters."""
