"""World, fences and campaign file in the facts of a recording, as far as they are readable."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache

from pydantic import ValidationError

from wil_campaign.campaigns.schema.vehicles import BodyPart
from wil_campaign.campaigns.setup.case_files import names_in_own_file
from wil_campaign.foundation.files.documents import BadInput, Data
from wil_campaign.orchestrator.recording.recording_facts import campaign_in, fences_in, world_in
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.oracles.registry import own_oracle_keys
from wil_campaign.vehicles.embedded.physics.contact_world import BODY
from wil_campaign.worlds.frames import Vec3
from wil_campaign.worlds.scene.parts import BoxShape
from wil_campaign.worlds.scene.scene import Scene
from wil_campaign.worlds.world_file.world import Mode, Which, World

_MOST_OVERRIDES = 60


@dataclass(frozen=True, slots=True)
class RecordedWorld:
    """judged: the scene that the run was judged by. physical: names of its objects in W.

    campaign, recipe: the files as flown; recipe is empty where nothing was mixed.
    """

    judged: Scene = field(default_factory=Scene)
    physical: frozenset[str] = frozenset()
    fences: Mapping[str, Fence] = field(default_factory=dict)
    campaign: Mapping[str, Data] = field(default_factory=dict)
    overrides: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()
    recipe: str = ""

    def targets_ned_m(self, events: Mapping[str, float]) -> list[Vec3]:
        """Return the positions of the goal's gates and of its target position."""
        goal = self.campaign.get("goal")
        if not isinstance(goal, dict):
            return []
        found = [self.judged[name] for name in self.gates if name in self.judged]
        places = [
            obj.pose_at(0.0, events).compose(opening.pose).position_ned_m
            for obj in found
            for opening in obj.shape.openings
        ]
        target = goal.get("position")
        if isinstance(target, dict):
            values = [target.get(key) for key in ("north_m", "east_m", "up_m")]
            north, east, up = (float(v) if isinstance(v, int | float) else 0.0 for v in values)
            places.append((north, east, -up))
        return places

    @property
    def formulas(self) -> dict[str, str]:
        """Return the formulas of the campaign's oracles, by name: values of an own key."""
        given = self.oracles.items()
        pairs = [
            (name, one.get(key))
            for name, one in given
            if isinstance(one, dict)
            for key in own_oracle_keys()
        ]
        return {name: text for name, text in pairs if isinstance(text, str)}

    @property
    def oracles(self) -> Mapping[str, Data]:
        """Return the oracles of the campaign file, by name."""
        given = self.campaign.get("oracles")
        return given if isinstance(given, dict) else {}

    @property
    def gates(self) -> list[str]:
        """Return the names of the goal's gates."""
        goal = self.campaign.get("goal")
        gates = goal.get("gates") if isinstance(goal, dict) else None
        return [name for name in gates if isinstance(name, str)] if isinstance(gates, list) else []


def recorded_body(campaign: Mapping[str, Data], vehicle: str) -> BoxShape:
    """Return a vehicle's body by which it was judged; by default that of the embedded vehicle."""
    found: Data = dict(campaign)
    for key in ("vehicles", vehicle, "body"):
        found = found.get(key) if isinstance(found, dict) else None
    if found is None:
        return BODY
    try:
        return BodyPart.model_validate(found).shape()
    except ValidationError:
        return BODY


def recorded_world(facts: Mapping[str, str], case: str, mode: str) -> RecordedWorld:
    """Return the world in the facts of a recording; an empty one without it."""
    if "world" not in facts:
        why = "run.mcap has no world and fence of the flight; they are not drawn"
        return RecordedWorld(problems=(why,))
    problems: list[str] = []
    judged, physical = Scene(), frozenset[str]()
    try:
        world = _parsed_world(facts["world"], facts.get("world_file", ""))
        which: Which = "W" if mode == "real" else "Wv"
        flown: Mode = "sim" if mode == "sim" else "real" if mode == "real" else "wil"
        judged = world.scene(flown, which)
        physical = frozenset(() if mode == "sim" else world.scene(flown, "W").names)
    except BadInput as error:
        problems.append(f"the world cannot be drawn: {error.problems[0].message}")
    fences: Mapping[str, Fence] = {}
    campaign: Mapping[str, Data] = {}
    try:
        fences = fences_in(facts)
        campaign = campaign_in(facts)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        problems.append(f"the fence or the campaign in run.mcap cannot be read: {error}")
    overrides = tuple(_overrides(campaign, case))
    return RecordedWorld(
        judged, physical, fences, campaign, overrides, tuple(problems), facts.get("recipe", "")
    )


@lru_cache(maxsize=8)
def _parsed_world(text: str, file: str) -> World:
    """Return a world; cached, as runs share worlds."""
    world = world_in({"world": text, "world_file": file})
    assert world is not None  # noqa: S101 - the fact is given
    return world


def _overrides(campaign: Mapping[str, Data], case: str) -> list[str]:
    """Return the overrides of a run's case or control, one key per text."""
    given = _entry_of(campaign.get("cases"), case)
    if given is None:
        control = _entry_of(campaign.get("controls"), case)
        given = control.get("set") if isinstance(control, dict) else None
    if not isinstance(given, dict):
        return []
    texts = [f"{key}: {json.dumps(value, default=str)}" for key, value in given.items()]
    return texts[:_MOST_OVERRIDES]


def _entry_of(entries: Data, case: str) -> Data:
    """Return what a file says of a run's case or control; None without it."""
    known = entries if isinstance(entries, dict) else {}
    return next((known[name] for name in names_in_own_file(case) if name in known), None)
