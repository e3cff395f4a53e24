"""Reads one run of a results folder into its report; what is missing becomes a problem."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from wil_campaign.orchestrator.reading.judged_motion import (
    JudgedMotion,
    read_judged_motion,
)
from wil_campaign.orchestrator.reading.model import CommandedState, RunEntry
from wil_campaign.orchestrator.reading.trajectory_file import TrajectoryFileRow, read_trajectory
from wil_campaign.orchestrator.recording.run_video import FILE_NAME as VIDEO
from wil_campaign.orchestrator.report.model import (
    Closeup,
    DrawnWorld,
    PageImage,
    PerceivedSight,
    Point,
    RunReport,
    VehicleAtMoment,
    VehicleTrack,
    VerdictCause,
)
from wil_campaign.orchestrator.report.reading.cause import (
    SAME_MOMENT_S,
    ContactFacts,
    NearestPass,
    deciding_oracle,
    report_moment_of,
    run_success_of,
    verdict_cause_of,
    verdict_notes_of,
)
from wil_campaign.orchestrator.report.reading.closeup import JudgedFlight, closeup_of
from wil_campaign.orchestrator.report.reading.distances import TimedPose, contact_until_s, fence_at
from wil_campaign.orchestrator.report.reading.even_tracks import (
    EvenTimes,
    even_poses,
    even_track_of,
    poses_from,
)
from wil_campaign.orchestrator.report.reading.event_log import EventLog, read_event_log
from wil_campaign.orchestrator.report.reading.headline import headline_of
from wil_campaign.orchestrator.report.reading.held_limits import held_limits
from wil_campaign.orchestrator.report.reading.object_marks import (
    SeenWorld,
    marks_of,
    objects_named_in_texts,
    touched_part,
)
from wil_campaign.orchestrator.report.reading.outlines import outlines_of
from wil_campaign.orchestrator.report.reading.recorded_sights import read_facts, read_sights
from wil_campaign.orchestrator.report.reading.sight_decoding import (
    ImageSize,
    decode_sights,
    video_sights,
)
from wil_campaign.orchestrator.report.reading.signal_plots import mixture_plots, motion_plots
from wil_campaign.orchestrator.report.reading.world_facts import (
    RecordedWorld,
    recorded_body,
    recorded_world,
)
from wil_campaign.orchestrator.report.words import place_text, short_time, time_text, velocity_text
from wil_campaign.orchestrator.run_results.evidence_files import foreign_files
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.model.oracle_results import OracleResult
from wil_campaign.worlds.frames import Pose, norm, quat_from_euler

STRIP_S = (-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0)
"""Times of the strip's frames, relative to the moment."""
_MP4_MARK = b"ftyp"
"""Follows the length of an MP4 file's first box."""


@dataclass(slots=True)
class _Parts:
    """The contents of a run's files."""

    log: EventLog
    motion: JudgedMotion
    commands: tuple[TrajectoryFileRow, ...]
    world: RecordedWorld
    problems: list[str]
    stages: dict[str, float] = field(default_factory=dict)

    @property
    def goal_s(self) -> float | None:
        return self.stages.get("goal")

    @property
    def fences(self) -> dict[str, list[tuple[float, Fence]]]:
        """The fences of each vehicle, the one at the start first, with their times."""
        found = {name: [(-math.inf, fence)] for name, fence in self.world.fences.items()}
        for name, changed in self.motion.fences.items():
            found.setdefault(name, []).extend(changed)
        return found

    @property
    def span_s(self) -> Point:
        """Return the time that plots show: from takeoff to the end, or the whole recording."""
        stamps = [row.t_s for row in self.commands]
        stamps += [t_s for poses in self.motion.poses.values() for t_s, _ in poses[:1] + poses[-1:]]
        stamps += self.stages.values()
        if not stamps:
            return (0.0, 0.0)
        begin_s = self.stages.get("takeoff", min(stamps))
        return (begin_s, max(begin_s, *stamps))


def read_run(folder: Path, entry: RunEntry, size: ImageSize) -> RunReport:
    """Return the report of a run. folder: the campaign's; size: of the images."""
    place = folder / entry.name
    if not place.is_dir():
        return _without_files(entry)
    parts = _read_parts(place, entry)
    subject = "twin" if entry.mode == "sim" else "real"
    times = EvenTimes.over(parts.span_s)
    recorded = _poses(parts)
    flown = {name: poses_from(found, times.begin_s) for name, found in recorded.items()}
    poses = {name: even_poses(found, times) for name, found in recorded.items()}
    passed = _nearest_pass(parts, flown.get(subject, []))
    result = entry.result
    cause = None
    if result is not None:
        cause = verdict_cause_of(
            result,
            parts.log.events,
            goal_s=parts.goal_s,
            passed=passed,
            formulas=parts.world.formulas,
            outcome=tuple(_outcome(parts, flown.get(subject, []))),
            contact_at=lambda vehicle, t_s: _contact(parts, vehicle, t_s),
        )
    limits = held_limits(parts.world.oracles, parts.stages, parts.span_s[1], subject)
    flight = JudgedFlight(parts.motion, parts.world.judged, parts.fences, parts.world.campaign)
    oracle = None if result is None else deciding_oracle(result)
    closeup = closeup_of(cause, oracle, limits, flight)
    cause = _with_headline(_with_worst(cause, closeup, parts.goal_s), parts, result, passed)
    stages = parts.stages
    recorded_s = parts.span_s[1] if parts.commands or poses else None
    moment = report_moment_of(result, cause, stages=stages, passed=passed, end_s=recorded_s)
    at_s = None if moment is None else moment.t_s
    wanted = () if at_s is None else tuple(at_s + offset_s for offset_s in STRIP_S)
    sights = read_sights(place / "run.mcap", mode=entry.mode, wanted_s=wanted)
    shown = decode_sights(sights, size, at_s=at_s)
    has_images = any(isinstance(sight.perceived, PageImage) for sight in shown)
    video, video_problems = _read_video(place / VIDEO)
    if not shown and wanted and video is not None:
        shown = video_sights(video, wanted, size)
    end_s = parts.log.images_end_s
    ended = {sight.wanted_s for sight in shown if _had_ended(sight, end_s)}
    shown = [sight for sight in shown if sight.wanted_s not in ended]
    problems = (*entry.problems, *parts.problems, *sights.problems, *video_problems)
    files = tuple(sorted(path.name for path in place.iterdir() if path.is_file()))
    return RunReport(
        name=entry.name,
        case=entry.case,
        mode=entry.mode,
        rep=entry.rep,
        result=result,
        problems=tuple(dict.fromkeys(problems)),
        cause=cause,
        success=None if result is None else run_success_of(result, goal_s=parts.goal_s),
        notes=_notes(result, cause, parts.goal_s),
        moment=moment,
        at_moment=() if at_s is None else tuple(_at_moment(parts, at_s)),
        goal_s=parts.goal_s,
        span_s=parts.span_s,
        stages=tuple(stages.items()),
        tracks=tuple(_tracks(parts, poses, times)),
        commands=_thinned(parts.commands, parts.span_s),
        world=_drawn_world(parts, poses, at_s),
        closeup=closeup,
        sight=None if at_s in ended else _marked(_nearest(shown, at_s), parts, oracle),
        images_end_s=end_s if at_s in ended else None,
        strip=tuple(shown),
        plots=(
            *motion_plots(flown, flight, subject, limits),
            *mixture_plots(sights.provenances, at_s),
        ),
        events=parts.log.events,
        preflight=parts.log.preflight,
        before_arming=parts.log.before_arming,
        events_left_out=parts.log.left_out,
        video=None if video is None else VIDEO,
        video_bytes=0 if video is None else video.stat().st_size,
        has_images=has_images,
        files=files,
        overrides=parts.world.overrides,
    )


def _without_files(entry: RunEntry) -> RunReport:
    missing = "the run was not flown, or its folder is missing"
    problems = (missing,) if entry.result is None else (*entry.problems, missing)
    cause = None
    if entry.result is not None:
        cause = verdict_cause_of(entry.result, (), goal_s=None, passed=None)
    return RunReport(
        name=entry.name,
        case=entry.case,
        mode=entry.mode,
        rep=entry.rep,
        result=entry.result,
        problems=problems,
        cause=cause,
        notes=_notes(entry.result, cause, None),
    )


def _notes(
    result: RunResult | None, cause: VerdictCause | None, goal_s: float | None
) -> tuple[str, ...]:
    if result is None:
        return ()
    return verdict_notes_of(result, at_s=None if cause is None else cause.at_s, goal_s=goal_s)


def _outcome(parts: _Parts, poses: Sequence[TimedPose]) -> Iterator[tuple[float, str]]:
    """Yield how the flight continued: goal done, landing, and the last pose of the vehicle."""
    texts = {"done": "the goal was done", "landed": "the run counts as landed"}
    for stage, text in texts.items():
        if stage in parts.stages:
            yield parts.stages[stage], text
    if poses:
        t_s, pose = poses[-1]
        up_m = round(-pose.position_ned_m[2], 2) or 0.0
        yield t_s, f"last pose: {up_m:.2f} m above the world's origin"


def _contact(parts: _Parts, vehicle: str, t_s: float) -> ContactFacts:
    """Return a vehicle's contact at a time, with its speed and end."""
    before = (row for row in reversed(parts.commands) if row.vehicle == vehicle and row.t_s <= t_s)
    row = next(before, None)
    velocity = None if row is None else row.decoded().velocity_ned_m_s
    poses = parts.motion.poses.get(vehicle, [])
    body = recorded_body(parts.world.campaign, vehicle)
    until_s = contact_until_s(poses, body, parts.world.judged, parts.motion.world_events, t_s)
    recorded_s = poses[-1][0] if poses and parts.world.judged.objects else None
    return ContactFacts(None if velocity is None else norm(velocity), until_s, recorded_s)


def _with_worst(
    cause: VerdictCause | None, closeup: Closeup | None, goal_s: float | None
) -> VerdictCause | None:
    """Return a cause with the time of the worst value, where its oracle has none."""
    if cause is None or closeup is None or any(name == "worst" for name, _ in cause.facts):
        return cause
    if closeup.worst[0] - closeup.crossed_s <= SAME_MOMENT_S:
        return cause
    facts = [("crossed" if name == "when" else name, text) for name, text in cause.facts]
    place = next((i + 1 for i, (name, _) in enumerate(facts) if name == "crossed"), len(facts))
    facts.insert(place, ("worst", time_text(closeup.worst[0], goal_s)))
    return replace(cause, facts=tuple(facts))


def _with_headline(
    cause: VerdictCause | None, parts: _Parts, result: RunResult | None, passed: NearestPass | None
) -> VerdictCause | None:
    """Return a cause with its headline, where the record tells what the vehicle did."""
    if cause is None or result is None:
        return cause
    oracle = deciding_oracle(result)
    vehicle = result.subject if oracle is None else oracle.vehicle
    contact = ContactFacts() if cause.at_s is None else _contact(parts, vehicle, cause.at_s)
    headline = headline_of(
        result,
        oracle,
        _poses(parts).get(vehicle, []),
        stages=parts.stages,
        at_s=cause.at_s,
        speed_m_s=contact.speed_m_s,
        passed=passed,
    )
    return replace(cause, headline=headline)


def _marked(
    sight: PerceivedSight | None, parts: _Parts, oracle: OracleResult | None
) -> PerceivedSight | None:
    """Return a sight with the relevant objects marked in its image."""
    if sight is None or not isinstance(sight.perceived, PageImage):
        return sight
    world, motion = parts.world, parts.motion
    detail = "" if oracle is None else oracle.detail
    given = None if oracle is None else world.oracles.get(oracle.name)
    named = str(given.get("object", "")) if isinstance(given, dict) else ""
    moving = [obj.name for obj in world.judged.objects if obj.motion is not None]
    wanted = [*objects_named_in_texts(world.judged, [detail, named]), *world.gates, *moving]
    seen = SeenWorld(
        world.judged,
        world.physical,
        motion.poses,
        motion.world_events,
        world.campaign,
        world.recipe,
    )
    marks = marks_of(
        sight.perceived, sight.sensor, seen, of_interest=wanted, touched=touched_part(detail)
    )
    return replace(sight, marks=marks)


def _read_parts(place: Path, entry: RunEntry) -> _Parts:
    log = read_event_log(place / "log.jsonl")
    motion = read_judged_motion(place / "judged.msgpack")
    trajectory = read_trajectory(place / "trajectory.csv")
    facts = read_facts(place / "run.mcap")
    world = recorded_world(facts, entry.case, entry.mode)
    problems = [*log.problems, *motion.problems, *trajectory.problems, *world.problems]
    if entry.result is not None:
        problems += foreign_files(place, entry.result.evidence_files)
        problems += _foreign_recording(facts, entry.result)
    stages = dict(log.stages) or dict(motion.stages)
    if entry.result is not None and motion.poses and "end" not in motion.stages:
        last_s = max(t_s for poses in motion.poses.values() for t_s, _ in poses[-1:])
        problems.append(f"judged.msgpack ends at {last_s:.2f} s, before the end of the run")
    return _Parts(log, motion, trajectory.rows, world, problems, stages)


def _foreign_recording(facts: Mapping[str, str], result: RunResult) -> list[str]:
    """Return in a sentence that a recording is of another run by its facts; none without them."""
    own = {
        "case": result.case,
        "mode": result.mode,
        "rep": str(result.rep),
        "seed": str(result.seed),
    }
    stated = {name: facts.get(name, value) for name, value in own.items()}
    if stated == own:
        return []
    name = f"{stated['case']}/{stated['mode']}/{stated['rep']}"
    return [f"run.mcap is not that of this flight: it is of {name} with seed {stated['seed']}"]


def _poses(parts: _Parts) -> dict[str, list[TimedPose]]:
    """Return the judged poses of each vehicle; without a judge log, those of trajectory.csv."""
    if parts.motion.poses:
        return parts.motion.poses
    found: dict[str, list[TimedPose]] = {}
    for raw in parts.commands:
        row = raw.decoded()
        place = row.truth_ned_m or row.position_ned_m
        if place is not None:
            upright = quat_from_euler(0.0, 0.0, 0.0)
            found.setdefault(row.vehicle, []).append((row.t_s, Pose(place, upright)))
    return found


def _tracks(
    parts: _Parts, poses: Mapping[str, list[TimedPose]], times: EvenTimes
) -> list[VehicleTrack]:
    source = "as judged" if parts.motion.poses else "from trajectory.csv"
    return [even_track_of(name, source, found, times) for name, found in poses.items() if found]


def _read_video(path: Path) -> tuple[Path | None, tuple[str, ...]]:
    """Return the path of a playable video, or why an existing one cannot be shown."""
    if not path.exists():
        return None, ()
    try:
        with path.open("rb") as file:
            is_mp4 = file.read(8)[4:] == _MP4_MARK
    except OSError as error:
        return None, (f"{path.name} cannot be read: {error.strerror or error}",)
    return (path, ()) if is_mp4 else (None, (f"{path.name} is not an MP4 file",))


def _nearest_pass(parts: _Parts, poses: Sequence[TimedPose]) -> NearestPass | None:
    """Return the judged vehicle's nearest pass of its goal's first gate or position."""
    targets = parts.world.targets_ned_m(parts.motion.world_events)
    if not targets:
        return None
    begin_s = parts.stages.get("goal", -math.inf)
    end_s = parts.stages.get("land", math.inf)
    flown = (
        NearestPass(t_s, math.dist(pose.position_ned_m, targets[0]))
        for t_s, pose in poses
        if begin_s <= t_s <= end_s
    )
    return min(flown, key=lambda one: one.distance_m, default=None)


def _drawn_world(
    parts: _Parts, poses: Mapping[str, list[TimedPose]], at_s: float | None
) -> DrawnWorld:
    places = [pose.position_ned_m for found in poses.values() for _, pose in found]
    side_axis = "north"
    if places:
        spans = [max(p[axis] for p in places) - min(p[axis] for p in places) for axis in (0, 1)]
        side_axis = "east" if spans[1] > spans[0] else "north"
    world = parts.world
    outlines = outlines_of(
        world.judged,
        world.physical,
        side_axis=side_axis,
        t_s=parts.span_s[0] if at_s is None else at_s,
        events=parts.motion.world_events,
        span_s=parts.span_s,
    )
    return DrawnWorld(outlines, *_drawn_fences(parts, at_s), side_axis)


def _drawn_fences(parts: _Parts, at_s: float | None) -> tuple[dict[str, Fence], str]:
    """Return the fences in force at the moment, and when they were changed, as text."""
    shown_s = parts.span_s[1] if at_s is None else at_s
    in_force = {name: fence_at(fences, shown_s) for name, fences in parts.fences.items()}
    drawn = {name: fence for name, fence in in_force.items() if fence is not None}
    changed_s = sorted({t_s for fences in parts.motion.fences.values() for t_s, _ in fences})
    if not changed_s:
        return drawn, ""
    first = short_time(changed_s[0], parts.goal_s)
    when = f"at {first}" if len(changed_s) == 1 else f"{len(changed_s)} times, first at {first}"
    moment = "the end of the flight" if at_s is None else "the moment"
    return drawn, f"in force at {moment}; it was changed in flight {when}"


def _at_moment(parts: _Parts, t_s: float) -> list[VehicleAtMoment]:
    """Return state and command of each vehicle at a time."""
    newest: dict[str, TrajectoryFileRow] = {}
    noted_s: dict[str, float] = {}
    for row in parts.commands:
        last = newest.get(row.vehicle)
        if last is None or row.t_s <= t_s:
            if last is None or row.note != last.note:
                noted_s[row.vehicle] = row.t_s
            newest[row.vehicle] = row
    return [
        VehicleAtMoment(name, tuple(_facts(row.decoded(), noted_s[name], parts.goal_s)))
        for name, row in newest.items()
    ]


def _facts(row: CommandedState, noted_s: float, goal_s: float | None) -> list[tuple[str, str]]:
    commanded = "nothing"
    if row.setpoint is not None:
        as_text = velocity_text if row.setpoint_kind == "velocity" else place_text
        commanded = f"{row.setpoint_kind}: {as_text(row.setpoint)}"
        if row.setpoint_yaw_rad is not None:
            commanded += f", heading {round(math.degrees(row.setpoint_yaw_rad))}°"
    noted = f"{row.note}, since {short_time(noted_s, goal_s)}" if row.note else ""
    facts = [("commanded", commanded), ("noted", noted)]
    facts.append(("was at", place_text(row.truth_ned_m or row.position_ned_m)))
    facts.append(("flew", velocity_text(row.velocity_ned_m_s)))
    armed = "armed" if row.is_armed else "disarmed"
    facts.append(("mode", f"{row.mode}, {armed}, stage {row.stage}"))
    return [(name, text) for name, text in facts if text]


def _thinned(commands: Sequence[TrajectoryFileRow], span_s: Point) -> tuple[CommandedState, ...]:
    """Return the setpoints of each vehicle for the map, at least half a second apart."""
    step_s = max(0.5, (span_s[1] - span_s[0]) / 60)
    due: dict[str, float] = {}
    kept = []
    for row in commands:
        if row.t_s < due.get(row.vehicle, span_s[0]):
            continue
        found = row.decoded()
        if found.setpoint is not None:
            due[row.vehicle] = row.t_s + step_s
            kept.append(found)
    return tuple(kept)


def _had_ended(sight: PerceivedSight, end_s: float | None) -> bool:
    """Return whether the images had ended at a sight's time: the last one does not show it."""
    if end_s is None or not isinstance(sight.perceived, PageImage):
        return False
    return sight.perceived.delivered_s <= end_s < sight.wanted_s


def _nearest(sights: Sequence[PerceivedSight], at_s: float | None) -> PerceivedSight | None:
    if at_s is None:
        return None
    return min(sights, key=lambda one: abs(one.wanted_s - at_s), default=None)
