"""The context that an oracle gets of its run: the judged world, the goal, the fence."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal, Protocol

from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.worlds.frames import Pose, Vec3
from wil_campaign.worlds.geodesy import LocalFrame
from wil_campaign.worlds.scene.parts import OpeningCrossing

RunMode = Literal["sim", "wil", "real"]


class ObjectSeparation(Protocol):
    """An oracle context's least clearance to an object (protocol of worlds' Clearance).

    The floor of a room is distinguished from the rest of it.
    """

    @property
    def object_name(self) -> str:
        """Return the separated object's name in the world file."""

    @property
    def part_name(self) -> str:
        """Return the nearest part of the separated object ("left"); empty for only one."""

    @property
    def clearance_m(self) -> float:
        """Return the least distance between the vehicle's body and the object; <= 0: contact."""

    @property
    def at_s(self) -> float:
        """Return the time of the least separation on the run clock."""

    @property
    def is_floor(self) -> bool:
        """Return whether the separated object is a floor that vehicles stand on."""


class WorldProbe(Protocol):
    """An oracle context's clearance probe of the judged world (protocol of ClearanceProbe)."""

    def reaching(self, distance_m: float, /) -> "WorldProbe":
        """Return the probe for an oracle that needs objects up to a distance, in metres."""

    def above(self, ground_down_m: float, /) -> "WorldProbe":
        """Return the probe with a level ground, a floor of the name `GROUND`, at a height (NED)."""

    def sweep(
        self,
        pose_0: Pose,
        t_0_s: float,
        pose_1: Pose,
        t_1_s: float,
        events: Mapping[str, float],
        /,
        *,
        below_m: Mapping[tuple[str, bool], float] | None = None,
    ) -> tuple[ObjectSeparation, ...]:
        """Return the least clearance to each near object on the path between two poses.

        below_m: by object name and whether it is a floor; only smaller clearances are reported.
        """


class GateOpening(Protocol):
    """An oracle context's gate: an opening to fly through (protocol of SceneGate)."""

    @property
    def limit_m(self) -> float:
        """Return half the gate's inner size: the offset at which the centre meets the frame."""

    def depth_m(self, point_ned_m: Vec3, t_s: float, events: Mapping[str, float]) -> float:
        """Return a point's depth behind the gate's plane, along its forward axis."""

    def crossing(
        self, p_0: Vec3, t_0: float, p_1: Vec3, t_1: float, events: Mapping[str, float]
    ) -> OpeningCrossing | None:
        """Return where the path from one point to the next crosses the gate's plane."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OracleContext:
    """The context of an oracle: the run and the one vehicle it judges.

    vehicle: the judged vehicle. pose_source: of its judged poses; "mavlink" is its own estimate.
    body_half_m: half the sizes of its bounding box, forward, right
    and down from its centre; zeros for a point. probe: clearance to the world in which it is
    judged (Wv in sim and wil, W in real). ground_down_m: the height (NED) of the ground beneath
    what stands there; None where it is unknown. things: the names of the objects in that world;
    probe_of: returns a probe of one of them alone, without a limit of distance. gates: all
    openings of that world by name; route: those of the goal, in order. target_ned_m: a position
    goal. fence: that of this vehicle. touchdown_m_s: the fastest that it may sink as it lands, by
    its profile; None without one. frame: where on Earth the world is. events: times of the world's
    events; the run adds them as they happen.
    """

    mode: RunMode
    subject: str
    vehicle: str
    pose_source: str = "mavlink"
    body_half_m: Vec3 = (0.0, 0.0, 0.0)
    start: Pose = field(default_factory=lambda: Pose((0.0, 0.0, 0.0)))
    probe: WorldProbe | None = None
    ground_down_m: float | None = None
    touchdown_m_s: float | None = None
    things: tuple[str, ...] = ()
    probe_of: Callable[[str], WorldProbe] | None = None
    gates: Mapping[str, GateOpening] = field(default_factory=dict)
    route: tuple[str, ...] = ()
    target_ned_m: Vec3 | None = None
    fence: Fence | None = None
    frame: LocalFrame | None = None
    events: Mapping[str, float] = field(default_factory=dict)
