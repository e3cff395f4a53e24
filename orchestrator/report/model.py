"""The reading model: what a report shows of a campaign and of its runs; values only.

Times are on the run clock, seconds; positions NED metres in the world's local frame.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from orchestrator.analysis.model import Commanded
from orchestrator.model.results import RunResult
from safety.fence.geofence import Fence
from worlds.camera import Intrinsics
from worlds.frames import Pose, Vec3

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class LogEvent:
    """A line of log.jsonl. kind: stage, vehicle, guard, ...; subject: of whom; text: for people."""

    t_s: float
    kind: str
    subject: str
    text: str


@dataclass(frozen=True, slots=True)
class Track:
    """Where a vehicle was, at even times: the first at begin_s, then every step_s.

    source: where the poses come from, in words.
    """

    vehicle: str
    source: str
    begin_s: float
    step_s: float
    positions_ned_m: tuple[Vec3, ...]

    @property
    def end_s(self) -> float:
        """Return the time of the last position."""
        return self.begin_s + self.step_s * (len(self.positions_ned_m) - 1)

    def at(self, t_s: float) -> Vec3 | None:
        """Return the position nearest to a time; None without any."""
        if not self.positions_ned_m:
            return None
        index = round((t_s - self.begin_s) / self.step_s)
        return self.positions_ned_m[max(0, min(index, len(self.positions_ned_m) - 1))]


@dataclass(frozen=True, slots=True)
class Curve:
    """One line of a plot. subject: whose it is, "real", "twin" or "mixed"."""

    subject: str
    points: tuple[Point, ...]


@dataclass(frozen=True, slots=True)
class PlotLimit:
    """What values are held against. is_upper: whether they are to stay beneath; None: not known.

    span_s: when it holds; None for as long as the plot goes.
    """

    value: float
    is_upper: bool | None = None
    span_s: Point | None = None


@dataclass(frozen=True, slots=True)
class Plot:
    """Values over time. limits: what they are held against; note: how they were found.

    judged: the subject of the curve that the limits judge.
    """

    title: str
    unit: str
    curves: tuple[Curve, ...]
    limits: tuple[PlotLimit, ...] = ()
    note: str = ""
    judged: str = ""


@dataclass(frozen=True, slots=True)
class Closeup:
    """The value that violated its limit, about the time when it did.

    span_s: the time that is shown. crossed_s: when the limit was crossed; worst: when and what.
    """

    plot: Plot
    span_s: Point
    crossed_s: float
    worst: Point


@dataclass(frozen=True, slots=True)
class Outline:
    """A thing of the world, seen from above (east, north) and from the side (along, up); metres.

    is_virtual: it stands in Wv and not in W. route_*: the way that it goes, where it moves.
    """

    name: str
    is_virtual: bool
    is_room: bool
    rgb: tuple[int, int, int]
    above_m: tuple[tuple[Point, ...], ...]
    side_m: tuple[tuple[Point, ...], ...]
    route_above_m: tuple[Point, ...] = ()
    route_side_m: tuple[Point, ...] = ()


@dataclass(frozen=True, slots=True)
class DrawnWorld:
    """What stands round the vehicles. side_axis: what a view from the side has to the right."""

    outlines: tuple[Outline, ...] = ()
    fences: Mapping[str, Fence] = field(default_factory=dict)
    side_axis: str = "north"


@dataclass(frozen=True, slots=True)
class Frame:
    """An image for the page. jpeg: base64. t_s: exposure; delivered_s: when it was perceived.

    view: whose camera it is of, and with which optics; None where that was not recorded.
    """

    source: str
    t_s: float
    delivered_s: float
    width_px: int
    height_px: int
    jpeg: str
    view: "CameraView | None" = None


@dataclass(frozen=True, slots=True)
class CameraView:
    """The camera of an image as recorded. vehicle: on which it sits.

    camera_pose: where it was, NED; None where only the vehicle's pose is known.
    """

    vehicle: str
    intrinsics: Intrinsics
    camera_pose: Pose | None = None


@dataclass(frozen=True, slots=True)
class Mark:
    """Where a thing of the world is in an image, by the recorded world and poses; pixels.

    box_px: left, top, right, bottom of what is in view; None where nothing of it is. outline_px: of
    the part that was touched. distance_m: from the vehicle's body when the image was exposed.
    """

    name: str
    distance_m: float | None
    box_px: tuple[float, float, float, float] | None
    part: str = ""
    outline_px: tuple[Point, ...] = ()


@dataclass(frozen=True, slots=True)
class Scan:
    """A planar lidar scan. Angles in radians, to the right from forward; None: nothing met."""

    source: str
    t_s: float
    delivered_s: float
    start_angle_rad: float
    step_rad: float
    range_max_m: float
    ranges_m: tuple[float | None, ...]


@dataclass(frozen=True, slots=True)
class Sight:
    """What the autonomy perceived last before a time, and what that was mixed of.

    figures: of the mixture: skew, latency, registration error, what was left out; in words.
    sensor: its name. marks: the things that matter, in the image.
    """

    wanted_s: float
    perceived: Frame | Scan
    beside: tuple[Frame | Scan, ...] = ()
    figures: tuple[tuple[str, str], ...] = ()
    sensor: str = ""
    marks: tuple[Mark, ...] = ()


@dataclass(frozen=True, slots=True)
class Cause:
    """Why a run is no PASS. violated: what; facts: measured, limit, by how much, when, where.

    sequence: what happened in the order of its times, and how the flight ended; empty where there
    was one thing alone.
    """

    violated: str
    sentence: str
    facts: tuple[tuple[str, str], ...]
    at_s: float | None
    oracle: str = ""
    vehicle: str = ""
    sequence: tuple[tuple[float, str], ...] = ()


@dataclass(frozen=True, slots=True)
class Moment:
    """The time that a page is about, and why."""

    t_s: float
    why: str


@dataclass(frozen=True, slots=True)
class VehicleAtMoment:
    """A vehicle at the moment. facts: position, speed, mode, command, note; in words."""

    vehicle: str
    facts: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class RunReport:
    """One run. result: None where it has none that can be read. problems: what cannot be shown.

    notes: what the verdict does not rest on and a reader has to know: the twin, reported oracles.
    files: in its folder, from the campaign's. overrides: what its case changes, in words.
    """

    name: str
    case: str
    mode: str
    rep: str
    result: RunResult | None
    problems: tuple[str, ...] = ()
    cause: Cause | None = None
    notes: tuple[str, ...] = ()
    moment: Moment | None = None
    at_moment: tuple[VehicleAtMoment, ...] = ()
    goal_s: float | None = None
    span_s: Point = (0.0, 0.0)
    stages: tuple[tuple[str, float], ...] = ()
    tracks: tuple[Track, ...] = ()
    commands: tuple[Commanded, ...] = ()
    world: DrawnWorld = field(default_factory=DrawnWorld)
    closeup: Closeup | None = None
    sight: Sight | None = None
    strip: tuple[Sight, ...] = ()
    plots: tuple[Plot, ...] = ()
    events: tuple[LogEvent, ...] = ()
    preflight: tuple[LogEvent, ...] = ()
    before_arming: tuple[LogEvent, ...] = ()
    events_left_out: int = 0
    video: str | None = None
    video_bytes: int = 0
    files: tuple[str, ...] = ()
    overrides: tuple[str, ...] = ()
