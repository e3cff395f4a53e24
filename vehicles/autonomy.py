"""The autonomy under test: takes readings and a goal, gives setpoints.

One instance flies one vehicle. It is handed mixed readings and its own vehicle's telemetry and
nothing else: never a scene, never the other vehicle. It is pure in this sense: what it answers
depends only on what it was given, its parameters and the random generator it was handed.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from vehicles.readings import Reading
from vehicles.setpoints import Setpoint
from worlds.frames import Pose, Vec3


@dataclass(frozen=True, slots=True)
class Telemetry:
    """The vehicle's own estimate, world frame, as its autopilot reports it over MAVLink."""

    t_s: float
    pose: Pose
    velocity_ned_m_s: Vec3


@dataclass(frozen=True, slots=True)
class Command:
    """What the autonomy wants now; `done` says that it considers its goal reached.

    `note` is a short word for the record ("search", "approach", "through"), shown to people.
    """

    setpoint: Setpoint
    done: bool = False
    note: str = ""


@runtime_checkable
class Autonomy(Protocol):
    """An autonomy; built as `factory(goal=..., parameters=..., seed=...)` for each run."""

    def perceive(self, reading: Reading) -> None:
        """Take a new (mixed) reading, in order of delivery.

        `reading.sensor` is the name of its sensor in the recipe.
        """

    def act(self, telemetry: Telemetry) -> Command:
        """Return the command for now; called at the campaign's control rate."""


@runtime_checkable
class PerceivesRaw(Protocol):
    """An autonomy that also wants what its mixtures are made of, where a recipe publishes it."""

    def perceive_raw(self, reading: Reading) -> None:
        """Take a reading of `source` real or twin, just before its mixture."""


class AutonomyFactory(Protocol):
    """Builds an autonomy: a class with this constructor, or a function."""

    def __call__(
        self, *, goal: Mapping[str, float | str], parameters: Mapping[str, object], seed: int
    ) -> Autonomy:
        """Return a new autonomy. Raises ValueError on parameters that it does not know."""
