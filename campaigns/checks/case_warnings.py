"""Warnings of `validate`: what is valid in the files of a case, but probably not meant; pure."""

import math
from collections.abc import Iterator

from wil_campaign.campaigns.checks.actor_warnings import (
    estimated_actor_warnings,
    simulated_actor_warnings,
)
from wil_campaign.campaigns.checks.hidden_objects import hidden_object_warnings
from wil_campaign.campaigns.checks.limit_warnings import (
    exceeds_room,
    limit_warnings,
    narrow_gate_warnings,
    room_sizes,
    room_warnings,
)
from wil_campaign.campaigns.checks.magnitude_warnings import magnitude_warnings
from wil_campaign.campaigns.checks.mixture_warnings import (
    nothing_isolated_warnings,
    nothing_real_warnings,
    unmixed_object_warnings,
    unmixed_sensor_warnings,
    wide_registration_warnings,
)
from wil_campaign.campaigns.checks.place_checks import judged_world, large_fences
from wil_campaign.campaigns.schema import VEHICLES, Mode, VehicleName
from wil_campaign.campaigns.setup.case_files import CaseFiles
from wil_campaign.campaigns.setup.case_setup import FLIES, Case
from wil_campaign.campaigns.setup.vehicle_setups import unused_settings
from wil_campaign.foundation.files.documents import BadInput, Document, Path, Problem
from wil_campaign.safety.evaluation.judge import OracleUse
from wil_campaign.safety.fence.areas import Area, Polygon
from wil_campaign.safety.fence.fence_files import fence_warnings
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

_LONG_GAP_S = 1.0
"""In a longer gap between positions, a vehicle that brakes at 3 m/s^2 deviates from the straight
line by more than 0.4 m: a dt^2 / 8."""

_RAISED_M = 0.05
"""Half the height of the embedded vehicle's body: from here on contact with its own ground is not
contact with the world's."""

_SHOWN_WITHIN = (ReachedParameters, ReachedPositionParameters, TimeLimitParameters)
"""Oracles that need an event within their window: with an empty window they fail."""


def case_warnings(files: CaseFiles, case: Case, modes: tuple[Mode, ...]) -> Iterator[Problem]:
    """Yield warnings of a case for the flown modes: what is valid but probably not meant.

    A case with problems of its own may be given as well.
    """
    yield from document_warnings(files)
    yield from _unread_parameters(files.campaign, case)
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
    yield from _unfenced_vehicles(files.campaign, case, modes)
    yield from _raised_starts(files.campaign, case, modes)
    yield from _small_bodies(files.campaign, case)
    yield from _unused_parameters(files.campaign, case)
    yield from simulated_actor_warnings(files.campaign, case, modes)
    yield from _long_limits(files.campaign, case)
    if "wil" in modes:
        yield from unmixed_object_warnings(files, case)
        yield from unmixed_sensor_warnings(files, case)
    yield from limit_warnings(files.campaign, case)
    yield from magnitude_warnings(files, case)


def _unfenced_vehicles(file: Document, case: Case, modes: tuple[Mode, ...]) -> Iterator[Problem]:
    """Yield a warning for an attached vehicle without a fence, as it may be hardware."""
    for name in dict.fromkeys(name for mode in modes for name in FLIES[mode]):
        vehicle = case.vehicles.get(name)
        if vehicle is not None and vehicle.attached is not None and name not in case.fences:
            message = (
                f"'{name}' is attached, may be hardware, and has no geofence: neither the guard "
                "nor its autopilot stops it"
            )
            yield file.problem(("vehicles", name, "link"), message, key=True)


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


def document_warnings(files: CaseFiles) -> Iterator[Problem]:
    """Yield warnings of the files of a case that need no setup: fence files."""
    for document in files.fences.values():
        yield from fence_warnings(document)


def _unchecked_goals(files: CaseFiles, case: Case) -> Iterator[Problem]:
    """Yield a warning for a position and gates of the goal that no required oracle checks."""
    checked: set[str] = set()
    for use in case.oracles:
        if isinstance(use.parameters, ReachedParameters) and use.parameters.required:
            checked.update(
                case.goal.gates if use.parameters.gates is None else use.parameters.gates
            )
    for index, gate in enumerate(case.goal.gates):
        if gate not in checked:
            message = f"no required oracle checks that gate '{gate}' of the goal is flown through"
            yield files.campaign.problem(("goal", "gates", index), message)
    required = {type(use.parameters) for use in case.oracles if use.parameters.required}
    if case.goal.position_ned_m is not None and ReachedPositionParameters not in required:
        message = (
            "no required oracle checks that the goal's position is reached: `reached_position`"
        )
        yield files.campaign.problem(("goal", "position"), message)


def caveats_of(files: CaseFiles, case: Case, modes: tuple[Mode, ...]) -> Iterator[Problem]:
    """Yield the warnings of a case that are also caveats of each of its verdicts."""
    yield from _unread_parameters(files.campaign, case)
    yield from _idle_parts(files.campaign, case, modes)
    yield from _unchecked_goals(files, case)
    yield from _unperceived_mixture(files, case, modes)
    if "wil" in modes:
        yield from wide_registration_warnings(files, case)
        yield from nothing_isolated_warnings(files, case)
        yield from nothing_real_warnings(files, case)
        yield from hidden_object_warnings(files, case)
    yield from estimated_actor_warnings(files.campaign, case, modes)
    for mode in modes:
        scene = case.world.scene(mode, judged_world(mode))
        yield from narrow_gate_warnings(files.campaign, case, mode, scene)
    for name in dict.fromkeys(FLIES[mode][0] for mode in modes):
        yield from _long_gaps(files.campaign, case, name)


def _idle_parts(file: Document, case: Case, modes: tuple[Mode, ...]) -> Iterator[Problem]:
    """Yield a warning for oracles, faults and the like of a vehicle that flies in no mode."""
    flown = {name for mode in modes for name in FLIES[mode]}
    for use in case.oracles:
        named, path = use.parameters.vehicle, ("oracles", use.name)
        if "wil" not in modes and oracle_kinds()[use.kind].needs_pair(use.parameters):
            message = f"'{use.name}' judges a pair, and mode wil is not flown: it judges nothing"
            yield file.problem(path, message, key=True)
        elif named is not None and named not in flown:
            message = f"'{use.name}' judges '{named}', which no mode flies: it judges nothing"
            yield file.problem(path, message, key=True)
    in_the_air = {name for mode in modes for name in case.flying(mode)}
    for key in ("faults", *case.observers):
        for name in VEHICLES:
            has_effect = name in (flown if key == "faults" else in_the_air)
            if not has_effect and file.get((key, name)) is not None:
                message = f"no mode flies '{name}': {key}.{name} has no effect"
                yield file.problem((key, name), message, key=True)


def _unread_parameters(file: Document, case: Case) -> Iterator[Problem]:
    """Yield a warning for each key of `with` that the autonomy did not read while it was built."""
    for key, meant in case.unread.items():
        message = f"the autonomy never read `{key}` of its `with`"
        yield file.problem(("autonomy", "with", key), message, meant)


def _unperceived_mixture(
    files: CaseFiles, case: Case, modes: tuple[Mode, ...]
) -> Iterator[Problem]:
    """Yield a warning for a recipe that publishes no mixture to the vehicle that is judged."""
    if "wil" not in modes or case.recipe is None or files.recipe is None:
        return
    reached = case.recipe.sensors_for("real")
    if not reached and not any(observer.feeds_autopilots for observer in case.observers.values()):
        message = (
            "nothing is published to 'real': the vehicle judged in mode wil perceives no mixture"
        )
        yield files.recipe.problem(("combine",), message, key=True)


def _long_gaps(file: Document, case: Case, name: VehicleName) -> Iterator[Problem]:
    """Yield a warning for a judged vehicle whose positions may be missing for long."""
    vehicle = case.vehicles.get(name)
    if vehicle is None:
        return
    path: Path = ("vehicles", name, "telemetry", "max_gap_s")
    gap_s = vehicle.max_gap_s
    if vehicle.pose_source == "mocap":
        path = ("vehicles", name, "mocap", "stall_s")
        gap_s = None if vehicle.mocap is None else vehicle.mocap.stall_s
    if gap_s is not None and gap_s > _LONG_GAP_S:
        message = f"positions of '{name}' may be missing for {gap_s:g} s"
        yield file.problem(path, f"{message}: its flight meanwhile is not judged")


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
