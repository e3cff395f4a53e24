"""Warnings of `validate`: what is valid in the files of a case, but probably not meant; pure."""

import math
from collections.abc import Iterator

from wil_campaign.campaigns.checks.place_checks import judged_world, large_fences
from wil_campaign.campaigns.schema import Mode
from wil_campaign.campaigns.setup.case_files import CaseFiles
from wil_campaign.campaigns.setup.case_setup import FLIES, Case
from wil_campaign.campaigns.setup.vehicle_setups import unused_settings
from wil_campaign.foundation.files.documents import BadInput, Document, Path, Problem
from wil_campaign.plugins.hints.limit_warnings import (
    exceeds_room,
    limit_warnings,
    room_sizes,
    room_warnings,
)
from wil_campaign.plugins.hints.magnitude_warnings import magnitude_warnings
from wil_campaign.plugins.hints.unmixed_warnings import (
    unmixed_object_warnings,
    unmixed_sensor_warnings,
)
from wil_campaign.safety.evaluation.judge import OracleUse
from wil_campaign.safety.fence.areas import Area, Polygon
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.oracles.contact import ContactParameters
from wil_campaign.safety.oracles.goal import ReachedPositionParameters, TimeLimitParameters
from wil_campaign.safety.oracles.oracle_terms import StageWindow, Windowed
from wil_campaign.safety.oracles.reached import ReachedParameters
from wil_campaign.safety.oracles.registry import oracle_kinds
from wil_campaign.vehicles.embedded.profile import ProfileError, load_profile
from wil_campaign.worlds.frames import norm, subtract
from wil_campaign.worlds.scene.motion import StartOnEvent
from wil_campaign.worlds.scene.scene import Scene

_RAISED_M = 0.05
"""Half the height of the embedded vehicle's body: from here on contact with its own ground is not
contact with the world's."""

_SHOWN_WITHIN = (ReachedParameters, ReachedPositionParameters, TimeLimitParameters)
"""Oracles that need an event within their window: with an empty window they fail."""


def case_hints(files: CaseFiles, case: Case, modes: tuple[Mode, ...]) -> Iterator[Problem]:
    """Yield warnings of a case for the flown modes: what is valid but probably not meant.

    A case with problems of its own may be given as well.
    """
    for mode in modes:
        scene = case.world.scene(mode, judged_world(mode))
        yield from _wide_fences(files.campaign, case, mode, scene)
        yield from large_fences(files, case, mode, embedded=False)
        yield from _near_goals(files.campaign, case, mode, scene)
        yield from _without_objects(files.campaign, case, scene)
        yield from _empty_worlds(files.campaign, case, mode, scene)
        yield from _momentary_windows(files.campaign, case, mode)
        yield from room_warnings(files.campaign, case, scene)
        yield from _late_motions(files, case, scene)
    yield from _raised_starts(files.campaign, case, modes)
    yield from _small_bodies(files.campaign, case)
    yield from _unused_parameters(files.campaign, case)
    yield from _simulated_actors(files.campaign, case, modes)
    yield from _long_limits(files.campaign, case)
    if "wil" in modes:
        yield from unmixed_object_warnings(files, case)
        yield from unmixed_sensor_warnings(files, case)
    yield from limit_warnings(files.campaign, case)
    yield from magnitude_warnings(files, case)


def _raised_starts(file: Document, case: Case, modes: tuple[Mode, ...]) -> Iterator[Problem]:
    """Yield a warning for an embedded vehicle that starts above the ground of the world file."""
    ground_down_m = case.world.ground_down_m
    for name in dict.fromkeys(name for mode in modes for name in FLIES[mode]):
        vehicle = case.vehicles.get(name)
        if ground_down_m is None or vehicle is None or not vehicle.embedded:
            continue
        raised_m = ground_down_m - vehicle.start.position_ned_m[2]
        if raised_m > _RAISED_M:
            message = f"an embedded vehicle has flat ground at its start, {raised_m:g} m above"
            yield file.problem(
                ("vehicles", name, "start"),
                f"{message} ground_up_m: '{name}' does not get down to the ground that is judged",
                key=True,
            )


def _small_bodies(file: Document, case: Case) -> Iterator[Problem]:
    """Yield a warning for a vehicle without a body whose motors span more than the usual one."""
    for name, vehicle in case.vehicles.items():
        at: Path = ("vehicles", name)
        if not vehicle.embedded or file.get((*at, "body")) is not None:
            continue
        try:
            airframe = load_profile(vehicle.profile).airframe
        except (ProfileError, BadInput):
            continue  # a problem of the campaign
        width_m = 2.0 * vehicle.body.half_m[0]
        if airframe is not None and airframe.motor_span_m > width_m:
            message = f"vehicles.{name} has no body: {width_m:g} m is judged, but its motors alone"
            yield file.problem(at, f"{message} span {airframe.motor_span_m:.2f} m", key=True)


def _unused_parameters(file: Document, case: Case) -> Iterator[Problem]:
    """Yield warnings for parameters on which the embedded vehicles do not act."""
    for name, vehicle in case.vehicles.items():
        if vehicle.embedded:
            at: Path = ("vehicles", name)
            yield from unused_settings(file, at, vehicle.autopilot, vehicle.params)
    for actor in case.actors.values():
        if actor.embedded:
            yield from unused_settings(file, ("actors", actor.name), actor.autopilot, actor.params)


def _wide_fences(file: Document, case: Case, mode: Mode, scene: Scene) -> Iterator[Problem]:
    """Yield warnings for fences so much wider than the room that they do not limit the flight."""
    room_m = _room_size_m(scene)
    if room_m is None:
        return
    for name in FLIES[mode]:
        fence = case.fences.get(name)
        if fence is not None and exceeds_room(wide_m := _width_m(fence), max(room_m)):
            message = (
                f"the fence is {wide_m:g} m wide, and the room {max(room_m):g} m: it limits nothing"
            )
            yield file.problem(("geofence",), message, key=True)


def _near_goals(file: Document, case: Case, mode: Mode, scene: Scene) -> Iterator[Problem]:
    """Yield warnings for goal positions that nearly any flight reaches."""
    target = case.goal.position_ned_m
    subject = case.vehicles.get(FLIES[mode][0])
    if target is None or subject is None:
        return
    north_m, east_m, _ = subject.start.position_ned_m
    away_m = norm(subtract(target, (north_m, east_m, -case.goal.altitude_m)))
    room_m = _room_size_m(scene)
    for use in case.oracles:
        given = use.parameters
        if not isinstance(given, ReachedPositionParameters):
            continue
        path: Path = ("oracles", use.name, "tolerance_m")
        within = f"within {given.tolerance_m:g} m counts as reached"
        if given.tolerance_m >= away_m:
            message = f"{within}, and the goal is {away_m:.3g} m from the hover: it cannot fail"
            yield file.problem(path, message)
        elif room_m is not None and given.tolerance_m >= min(room_m) / 2.0:
            yield file.problem(path, f"{within}, in a room of {min(room_m):g} m")


def _without_objects(file: Document, case: Case, scene: Scene) -> Iterator[Problem]:
    """Yield warnings for contact oracles that ignore every object of the world."""
    for use in case.oracles:
        given = use.parameters
        left = set(scene.names) - set(getattr(given, "exclude", ()))
        if isinstance(given, ContactParameters) and scene.names and given.exclude and not left:
            message = f"oracle '{use.name}' excludes every object of the world: it cannot fail"
            yield file.problem(("oracles", use.name, "exclude"), message)


def _empty_worlds(file: Document, case: Case, mode: Mode, scene: Scene) -> Iterator[Problem]:
    """Yield a warning for a mode in whose judged world none of the world's objects exists."""
    if case.world.objects and not scene.names:
        which = judged_world(mode)
        message = f"in mode {mode} no object of the world exists in {which}: no contact is possible"
        yield file.problem(("world",), f"{message} (see exists_in)")


def _momentary_windows(file: Document, case: Case, mode: Mode) -> Iterator[Problem]:
    """Yield warnings for windows that close when they open: from done to land, with one vehicle."""
    for use in case.oracles:
        if isinstance(use.parameters, _SHOWN_WITHIN):
            continue
        if len(FLIES[mode]) == 1 and _window_of(use) == StageWindow("done", "land"):
            message = (
                f"in mode {mode} the window of '{use.name}' closes when it opens: it cannot fail"
            )
            yield file.problem(("oracles", use.name), message, key=True)


def _long_limits(file: Document, case: Case) -> Iterator[Problem]:
    """Yield warnings for time limits beyond the time-out of their stage: they never apply."""
    for use in case.oracles:
        given = use.parameters
        if not isinstance(given, TimeLimitParameters):
            continue
        longest_s, key = _longest_s(case, _window_of(use))
        if given.limit_s >= longest_s:
            message = f"{key} ends the stage after {longest_s:g} s: it cannot fail"
            yield file.problem(("oracles", use.name, "limit_s"), message)


def _late_motions(files: CaseFiles, case: Case, scene: Scene) -> Iterator[Problem]:
    """Yield warnings for motions that begin when the flight is over at the latest."""
    sync = case.sync
    limits = [(sync.goal_timeout_s, "sync.goal_timeout_s")]
    for use in case.oracles:
        given = use.parameters
        if not isinstance(given, TimeLimitParameters) or not given.required:
            continue
        if _window_of(use) == StageWindow("goal", "done"):
            limits.append((given.limit_s, f"oracles.{use.name}.limit_s"))
    goal_s, key = min(limits)
    longest: dict[str, tuple[float, str]] = {
        "goal": (goal_s, key),
        "done": (sync.landing_timeout_s, "sync.landing_timeout_s"),
    }
    before_goal = (sync.takeoff_timeout_s + goal_s, f"sync.takeoff_timeout_s with {key}")
    for scene_object in scene.objects:
        start = None if scene_object.motion is None else scene_object.motion.start
        if files.world is None or not isinstance(start, StartOnEvent):
            continue
        longest_s, key = longest.get(start.event, before_goal)
        if start.delay_s >= longest_s:
            message = (
                f"'{scene_object.name}' begins to move {start.delay_s:g} s after '{start.event}'"
            )
            reason = f"{key} ends the flight after {longest_s:g} s: it never moves"
            yield files.world.problem(
                ("objects", scene_object.name, "motion"), f"{message}; {reason}"
            )


def _window_of(use: OracleUse) -> StageWindow | None:
    """Return the window in which an oracle judges; None where its parameters are no window."""
    usual = oracle_kinds()[use.kind].window
    try:
        return use.parameters.window(usual) if isinstance(use.parameters, Windowed) else usual
    except ValueError:
        return None


def _longest_s(case: Case, window: StageWindow | None) -> tuple[float, str]:
    """Return the longest time between two stages of a run, and the key of the time-out."""
    sync = case.sync
    bounded: dict[StageWindow | None, tuple[float, str]] = {
        StageWindow("takeoff", "at_height"): (sync.takeoff_timeout_s, "sync.takeoff_timeout_s"),
        StageWindow("goal", "done"): (sync.goal_timeout_s, "sync.goal_timeout_s"),
        StageWindow("land", "landed"): (sync.landing_timeout_s, "sync.landing_timeout_s"),
    }
    return bounded.get(window, (math.inf, ""))


def _room_size_m(scene: Scene) -> tuple[float, float] | None:
    """Return length and width of the largest room, to warn of wide fences; None without one."""
    return max((size_m for size_m, _ in room_sizes(scene)), default=None, key=max)


def _corners_m(area: Area) -> tuple[tuple[float, float], ...]:
    """Return the corners (north, east) of an area or of its bounding box, for a fence warning."""
    if isinstance(area, Polygon):
        return area.corners_m
    north_m, east_m = area.centre_m
    reach_m = area.radius_m
    return (north_m - reach_m, east_m - reach_m), (north_m + reach_m, east_m + reach_m)


def _width_m(fence: Fence) -> float:
    """Return the longer side of a fence's bounding box, for the warning of wide fences."""
    points = [point for area in fence.inclusions for point in _corners_m(area)]
    if not points:
        return math.inf
    sides_m = [max(axis) - min(axis) for axis in zip(*points, strict=True)]
    return float(max(sides_m))


def _simulated_actors(file: Document, case: Case, modes: tuple[Mode, ...]) -> Iterator[Problem]:
    """Yield a warning for a simulated actor in the real world of an attached vehicle."""
    real = case.vehicles.get("real")
    if real is None or real.attached is None:
        return
    for mode in (one for one in modes if one != "sim"):
        physical = case.world.scene(mode, "W")
        for actor in case.actors_in(mode):
            if actor.name in physical and actor.attached is None:
                message = (
                    f"in mode {mode} '{actor.name}' exists in the real world, where 'real' is "
                    f"attached, but its vehicle is {actor.kind}: nothing is physically there; "
                    "attach it, or make it virtual by exists_in"
                )
                yield file.problem((*actor.path, "link"), message)
