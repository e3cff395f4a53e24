"""Gates: the openings of a scene's objects, moving or not, for oracles."""

from collections.abc import Mapping

from wil_campaign.worlds.frames import Vec3, rotate
from wil_campaign.worlds.scene.parts import ObjectOpening, OpeningCrossing
from wil_campaign.worlds.scene.scene import Scene, SceneObject

_CLOSE_M = 1e-6
"""Closer to the plane, depth is computed as a crossing is: both must agree on the side."""


class SceneGate:
    """One gate opening of an object, in the world's coordinates (NED metres)."""

    def __init__(self, thing: SceneObject, opening: ObjectOpening) -> None:
        self._thing = thing
        self._opening = opening
        at_rest = thing.pose.compose(opening.pose)
        self._centre_m = at_rest.position_ned_m
        self._axis = rotate(at_rest.q_wxyz, (1.0, 0.0, 0.0))

    @property
    def limit_m(self) -> float:
        """Return half of the gate's inner size."""
        return self._opening.limit_m

    def depth_m(self, point_ned_m: Vec3, t_s: float, events: Mapping[str, float]) -> float:
        """Return a point's depth behind the gate's plane, along its forward axis."""
        if self._thing.motion is None:
            centre, axis = self._centre_m, self._axis
            depth_m = (
                (point_ned_m[0] - centre[0]) * axis[0]
                + (point_ned_m[1] - centre[1]) * axis[1]
                + (point_ned_m[2] - centre[2]) * axis[2]
            )
            if abs(depth_m) > _CLOSE_M:
                return depth_m
        local_m = self._thing.pose_at(t_s, events).to_local(point_ned_m)
        return self._opening.pose.to_local(local_m)[0]

    def crossing(
        self, p_0: Vec3, t_0: float, p_1: Vec3, t_1: float, events: Mapping[str, float]
    ) -> OpeningCrossing | None:
        """Return where the path between two points crosses the gate's plane."""
        local_0 = self._thing.pose_at(t_0, events).to_local(p_0)
        local_1 = self._thing.pose_at(t_1, events).to_local(p_1)
        return self._opening.crossing(local_0, local_1)


def gates_of(scene: Scene) -> dict[str, SceneGate]:
    """Return a scene's gates by object; by "object.opening" where it has several."""
    gates: dict[str, SceneGate] = {}
    for thing in scene.objects:
        openings = thing.shape.openings
        for opening in openings:
            name = thing.name if len(openings) == 1 else f"{thing.name}.{opening.name}"
            gates[name] = SceneGate(thing, opening)
    return gates
