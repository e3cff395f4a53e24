"""The reading model: the contents of a run's report, as values only.

Times are on the run clock, seconds; positions NED metres in the world's local frame.
"""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from wil_campaign.orchestrator.reading.model import CommandedState
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose, Vec3

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class LogEvent:
    """A line of log.jsonl. kind: stage, vehicle, guard, ...; subject: vehicle or operator.

    oracle: whose flag it is; empty for other kinds.
    """

    t_s: float
    kind: str
    subject: str
    text: str
    oracle: str = ""


@dataclass(frozen=True, slots=True)
class VehicleTrack:
    """The path of a vehicle at even times: from begin_s, every step_s.

    source: the origin of the poses, as text.
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
class PlotCurve:
    """One line of a plot. subject: whose it is, "real", "twin" or "mixed".

    stretches: its unbroken parts in the order of time; in between there are no values.
    """

    subject: str
    stretches: tuple[tuple[Point, ...], ...]

    @property
    def points(self) -> tuple[Point, ...]:
        """Return the points of all stretches."""
        return tuple(itertools.chain.from_iterable(self.stretches))


@dataclass(frozen=True, slots=True)
class PlotLimit:
    """A limit on the values of a plot. is_upper: whether it is an upper limit; None: unknown.

    span_s: when it holds; None for the whole plot.
    """

    value: float
    is_upper: bool | None = None
    span_s: Point | None = None


@dataclass(frozen=True, slots=True)
class Plot:
    """Values over time, with their limits. note: how the values are measured.

    judged: the subject of the curve to which the limits apply.
    """

    title: str
    unit: str
    curves: tuple[PlotCurve, ...]
    limits: tuple[PlotLimit, ...] = ()
    note: str = ""
    judged: str = ""


@dataclass(frozen=True, slots=True)
class Closeup:
    """A close-up of the value that violated its limit, around that time.

    span_s: the time shown. crossed_s: when the limit was crossed; worst: time and value.
    """

    plot: Plot
    span_s: Point
    crossed_s: float
    worst: Point


@dataclass(frozen=True, slots=True)
class ObjectOutline:
    """An object of the world, seen from above (east, north) and from the side (along, up); metres.

    is_virtual: it is in Wv and not in W. route_*: its path, where it moves. depth_m: how far it
    extends away from who looks from the side, least and most.
    """

    name: str
    is_virtual: bool
    is_room: bool
    rgb: tuple[int, int, int]
    above_m: tuple[tuple[Point, ...], ...]
    side_m: tuple[tuple[Point, ...], ...]
    route_above_m: tuple[Point, ...] = ()
    route_side_m: tuple[Point, ...] = ()
    depth_m: Point = (0.0, 0.0)


def side_depth_m(position_ned_m: Vec3, side_axis: str) -> float:
    """Return how far away a place is for who looks from the side; metres, larger is behind.

    With north to the right one looks west, with east to the right one looks north.
    """
    north_m, east_m, _ = position_ned_m
    return north_m if side_axis == "east" else -east_m


@dataclass(frozen=True, slots=True)
class DrawnWorld:
    """The surroundings of the vehicles. side_axis: the axis to the right in the side view.

    fences: by vehicle, at the moment. fence_note: when they were changed in flight, as text.
    """

    outlines: tuple[ObjectOutline, ...] = ()
    fences: Mapping[str, Fence] = field(default_factory=dict)
    fence_note: str = ""
    side_axis: str = "north"


@dataclass(frozen=True, slots=True)
class PageImage:
    """An image for the page. webp: base64. t_s: exposure; delivered_s: delivery to the autonomy.

    view: the camera; None where it was not recorded. far_m: where its colours are those of depths,
    the end of their scale, metres; None for other images.
    """

    source: str
    t_s: float
    delivered_s: float
    width_px: int
    height_px: int
    webp: str
    view: "CameraView | None" = None
    far_m: float | None = None


@dataclass(frozen=True, slots=True)
class CameraView:
    """The camera of an image as recorded. vehicle: on which it is mounted.

    camera_pose: NED; None where only the vehicle's pose is known.
    """

    vehicle: str
    intrinsics: Intrinsics
    camera_pose: Pose | None = None


@dataclass(frozen=True, slots=True)
class ObjectMark:
    """The place of an object in an image, by the recorded world and poses; pixels.

    box_px: left, top, right, bottom of its visible part; None where it is out of view. outline_px:
    of the part that was touched. distance_m: from the vehicle's body at the exposure.
    """

    name: str
    distance_m: float | None
    box_px: tuple[float, float, float, float] | None
    part: str = ""
    outline_px: tuple[Point, ...] = ()


@dataclass(frozen=True, slots=True)
class SketchedReading:
    """A reading that is no image, and is drawn as its type does. document: its recorded message."""

    source: str
    t_s: float
    kind: str
    document: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class PerceivedSight:
    """The newest reading of the autonomy at a time, and the readings it was mixed from (beside).

    figures: of the mixture: skew, latency, registration error, what was left out; as texts.
    marks: the relevant objects in the image.
    """

    wanted_s: float
    perceived: PageImage | SketchedReading
    beside: tuple[PageImage | SketchedReading, ...] = ()
    figures: tuple[tuple[str, str], ...] = ()
    sensor: str = ""
    marks: tuple[ObjectMark, ...] = ()


@dataclass(frozen=True, slots=True)
class VerdictCause:
    """Why a run is not a PASS. facts: measured, limit, by how much, when, where.

    headline: what the vehicle did, as a person would say it; empty where only `sentence` serves.
    sequence: the decisive events in order of time, and the end of the flight; empty for a single
    event.
    """

    violated: str
    sentence: str
    facts: tuple[tuple[str, str], ...]
    at_s: float | None
    oracle: str = ""
    vehicle: str = ""
    sequence: tuple[tuple[float, str], ...] = ()
    headline: str = ""


@dataclass(frozen=True, slots=True)
class CheckMargin:
    """A required check that held; texts as shown. at_s: when it was tightest, or None."""

    name: str
    measured: str
    limit: str
    margin: str
    at_s: float | None


@dataclass(frozen=True, slots=True)
class RunSuccess:
    """Why a run passed. margins: of its required checks that measured something."""

    sentence: str
    margins: tuple[CheckMargin, ...]


@dataclass(frozen=True, slots=True)
class ReportMoment:
    """The time that a run's page shows, and why."""

    t_s: float
    why: str


@dataclass(frozen=True, slots=True)
class VehicleAtMoment:
    """A vehicle at the moment. facts: position, speed, mode, command, note; as texts."""

    vehicle: str
    facts: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class RunReport:
    """One run. result: None where it is missing or unreadable. problems: what cannot be shown.

    notes: facts that did not decide the verdict: the end of the twin, reported oracles. files:
    names in its folder. has_images: whether a video can be made of it. overrides: what its case
    changes, as texts. images_end_s: when drawn images ended, where the moment is later, so that it
    has no sight; else None.
    """

    name: str
    case: str
    mode: str
    rep: str
    result: RunResult | None
    problems: tuple[str, ...] = ()
    cause: VerdictCause | None = None
    success: RunSuccess | None = None
    notes: tuple[str, ...] = ()
    moment: ReportMoment | None = None
    at_moment: tuple[VehicleAtMoment, ...] = ()
    goal_s: float | None = None
    span_s: Point = (0.0, 0.0)
    stages: tuple[tuple[str, float], ...] = ()
    tracks: tuple[VehicleTrack, ...] = ()
    commands: tuple[CommandedState, ...] = ()
    world: DrawnWorld = field(default_factory=DrawnWorld)
    closeup: Closeup | None = None
    sight: PerceivedSight | None = None
    images_end_s: float | None = None
    strip: tuple[PerceivedSight, ...] = ()
    plots: tuple[Plot, ...] = ()
    events: tuple[LogEvent, ...] = ()
    preflight: tuple[LogEvent, ...] = ()
    before_arming: tuple[LogEvent, ...] = ()
    events_left_out: int = 0
    video: str | None = None
    video_bytes: int = 0
    has_images: bool = False
    files: tuple[str, ...] = ()
    overrides: tuple[str, ...] = ()
