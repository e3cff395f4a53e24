"""A run's world for the page: meshes of its objects, and poses of the moving ones; pure.

NED metres and quaternions wxyz; vertices in the object's own frame.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from wil_campaign.orchestrator.report.reading.world_facts import RecordedWorld, recorded_world
from wil_campaign.plugins.observer.observer_part import observer_in
from wil_campaign.worlds.frames import rotate
from wil_campaign.worlds.scene.meshes import Mesh
from wil_campaign.worlds.scene.scene import SceneObject

_MOST_FACES = 2000
"""An object with more faces is drawn as its bounding box."""
_DIGITS = 3
_CORNERS = np.array([(n, e, d) for n in (0, 1) for e in (0, 1) for d in (0, 1)], dtype=float)
_BOX_FACES = (
    *((0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)),
    *((2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)),
)
_PLAIN_RGB = (128, 128, 128)


@dataclass(frozen=True, slots=True)
class RunScene:
    """The world of a run. document: the message for the page."""

    world: RecordedWorld
    document: Mapping[str, Any]

    @classmethod
    def of(cls, run: str, facts: Mapping[str, str]) -> "RunScene":
        """Return the world in a run's facts; an empty one without it."""
        world = recorded_world(facts, facts.get("case", ""), facts.get("mode", ""))
        document = {
            "type": "scene",
            "run": run,
            "case": facts.get("case", ""),
            "mode": facts.get("mode", ""),
            "objects": [_object(obj, world) for obj in world.judged.objects],
            "targets": world.targets_ned_m({}),
            "problems": list(world.problems),
            "kinds": _kinds(facts),
            "epoch_s": _epoch_s(facts),
            "observer": _observer(world),
        }
        return cls(world, document)

    def moving(self, t_s: float, events: Mapping[str, float]) -> dict[str, Any]:
        """Return the poses of moving objects at a time of the run."""
        return {
            obj.name: _pose(obj, t_s, events)
            for obj in self.world.judged.objects
            if obj.motion is not None
        }


def _observer(world: RecordedWorld) -> dict[str, Any] | None:
    """Return where the campaign's observer stands and looks; None without one."""
    found = observer_in(world.campaign)
    if found is None:
        return None
    width_px, fx_px = found.intrinsics.width_px, found.intrinsics.fx_px
    return {
        "position_ned_m": found.pose.position_ned_m,
        "ahead_ned": rotate(found.pose.q_wxyz, (1.0, 0.0, 0.0)),
        "up_ned": rotate(found.pose.q_wxyz, (0.0, 0.0, -1.0)),
        "fov_rad": 2.0 * math.atan(width_px / 2.0 / fx_px),
    }


def _epoch_s(facts: Mapping[str, str]) -> float | None:
    """Return UTC of the run clock's zero, seconds since 1970; None for other clocks."""
    text = facts.get("epoch_ns", "")
    return int(text) / 1e9 if text.isdecimal() and facts.get("clock") == "wall" else None


def _kinds(facts: Mapping[str, str]) -> dict[str, str]:
    """Return the kind of each vehicle as text, by its link; empty where the links are unknown."""
    try:
        vehicles = json.loads(facts.get("campaign", "{}"))["vehicles"]
        links = {str(name): vehicle["link"] for name, vehicle in vehicles.items()}
    except (ValueError, KeyError, TypeError, AttributeError):
        return {}
    return {name: _kind(link) for name, link in links.items()}


def _kind(link: object) -> str:
    if link == "embedded":
        return "simulated: embedded"
    if isinstance(link, Mapping) and "launch" in link:
        return f"simulated: {link['launch']}"
    return "attached: may be hardware"


def _object(obj: SceneObject, world: RecordedWorld) -> dict[str, Any]:
    vertices_m, faces = _triangles(obj.shape.mesh)
    materials = obj.shape.mesh.materials
    return {
        "name": obj.name,
        "is_virtual": obj.name not in world.physical,
        "is_room": obj.is_room,
        "moves": obj.motion is not None,
        "rgb": list(materials[0].rgb if materials else _PLAIN_RGB),
        "vertices_m": vertices_m,
        "faces": faces,
        "pose": _pose(obj, 0.0, {}),
    }


def _triangles(mesh: Mesh) -> tuple[list[list[float]], list[list[int]]]:
    if len(mesh.faces) <= _MOST_FACES:
        return np.round(mesh.vertices_m, _DIGITS).tolist(), mesh.faces.tolist()
    low, high = mesh.vertices_m.min(axis=0), mesh.vertices_m.max(axis=0)
    corners: list[list[float]] = np.round(low + _CORNERS * (high - low), _DIGITS).tolist()
    return corners, [list(face) for face in _BOX_FACES]


def _pose(obj: SceneObject, t_s: float, events: Mapping[str, float]) -> dict[str, Any]:
    pose = obj.pose_at(t_s, events)
    return {"position_ned_m": pose.position_ned_m, "q_wxyz": pose.q_wxyz}
