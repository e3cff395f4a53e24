"""The physical objects around an embedded vehicle: those of its world's scene."""

import json
from collections.abc import Collection, Mapping
from pathlib import Path

from wil_campaign.foundation.files.documents import Document, parse_document
from wil_campaign.vehicles.embedded.physics.airframe import Airframe
from wil_campaign.worlds.clearance.clearance import ClearanceProbe
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.scene.parts import BoxShape
from wil_campaign.worlds.scene.scene import Scene
from wil_campaign.worlds.scene.track import ObjectTrack, RunHistory
from wil_campaign.worlds.world_file.world import Mode, Which, World

_NEAR_M = 0.05
"""Only contact matters here: objects farther away than one step's travel are not measured."""


def contact_box_of(airframe: Airframe) -> BoxShape:
    """Return the box of an airframe for contacts: half extents forward, right, down in metres."""
    half_m = airframe.body_width_m / 2.0
    return BoxShape((half_m, half_m, airframe.body_height_m / 2.0))


BODY: BoxShape = contact_box_of(Airframe())
"""The embedded vehicle's shape for oracles and for physical contact."""


class SceneContactWorld:
    """The contact world of a scene; touching the ground is not a contact.

    body: of the vehicle, half extents forward, right, down in metres. tracks: of objects that are
    other vehicles; they grow as those fly. without: names of objects that are no obstacles, as one
    that the vehicle takes off from: the flat ground of its physics is at the height of its start.
    """

    def __init__(
        self,
        *,
        scene: Scene,
        body: BoxShape,
        tracks: Mapping[str, ObjectTrack] | None = None,
        without: Collection[str] = (),
    ) -> None:
        self._probe = ClearanceProbe(scene, body, exclude=without, floors=False, within_m=_NEAR_M)
        self._events = RunHistory(tracks)

    def notify(self, event: str, t_s: float) -> None:
        """Notify the contact world of an event at t_s: moving objects may start."""
        self._events[event] = t_s

    def contact(self, pose_0: Pose, t_0: float, pose_1: Pose, t_1: float) -> str | None:
        """Return the first contact on the way between two poses, or None."""
        swept = self._probe.sweep(pose_0, t_0, pose_1, t_1, self._events)
        touched = [clearance for clearance in swept if clearance.clearance_m <= 0.0]
        first = min(touched, key=lambda one: one.at_s, default=None)
        return None if first is None else f"{first.object_name}.{first.part_name}".rstrip(".")


def contact_world_argument(
    world: Document,
    mode: Mode,
    which: Which,
    *,
    body: BoxShape = BODY,
    without: Collection[str] = (),
) -> str:
    """Return the contact world as text for `from_argument` in another process.

    body: of the vehicle. without: names of objects that are no obstacles there, as those whose
    positions that process does not know.
    """
    document = {"path": str(world.path), "mode": mode, "which": which, "world": world.data}
    return json.dumps({**document, "body": body.half_m, "without": sorted(without)})


def from_argument(argument: str) -> SceneContactWorld:
    """Return the contact world of a text. Raises BadInput, ValueError."""
    fields: Mapping[str, object] = json.loads(argument)
    path = Path(str(fields["path"]))
    document = parse_document(json.dumps(fields["world"]).encode(), name=path.name, path=path)
    mode: Mode = fields["mode"]  # type: ignore[assignment]  # written by as_argument
    which: Which = fields["which"]  # type: ignore[assignment]  # written by as_argument
    half_m: list[float] = fields["body"]  # type: ignore[assignment]  # written by as_argument
    without: list[str] = fields["without"]  # type: ignore[assignment]  # written by as_argument
    return SceneContactWorld(
        scene=World.parse(document).scene(mode, which),
        body=BoxShape((half_m[0], half_m[1], half_m[2])),
        without=without,
    )
