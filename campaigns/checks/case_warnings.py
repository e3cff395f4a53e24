"""Warnings of `validate`: what is valid in the files of a case, but probably not meant; pure."""

import math
from collections.abc import Iterator

from campaigns.checks.actor_warnings import estimated_actors, simulated_actors
from campaigns.checks.limit_warnings import exceeds_room, limit_warnings, room_warnings, rooms
from campaigns.checks.mixture_warnings import unmixed_objects, wide_registration_limits
from campaigns.checks.place_checks import judged_world
from campaigns.schema import Mode, VehicleName
from campaigns.setup.case_files import CaseFiles
from campaigns.setup.case_setup import FLIES, Setup
from safety.evaluation.judge import OracleUse
from safety.fence.areas import Area, Polygon
from safety.fence.geofence import Fence
from safety.oracles import registry
from safety.oracles.contact import ContactParameters
from safety.oracles.goal import ReachedPositionParameters, TimeLimitParameters
from safety.oracles.oracle_terms import Window, Windowed
from safety.oracles.reached import ReachedParameters
from worlds.files.documents import Data, Document, Path, Problem
from worlds.frames import norm, subtract
from worlds.scene.scene import Scene

_PART = math.pi / 12.0
_AS_TYPED = 2e-3
"""Angles that people type in radians are parts of a turn, to three digits: 1.571, 0.785, 3.142."""
_NARROW_DEG = 5.0
"""No camera of a drone sees less than this across."""

_LONG_GAP_S = 1.0
"""In a longer gap between positions, a vehicle that brakes at 3 m/s^2 deviates from the straight
line by more than 0.4 m: a dt^2 / 8."""

_SHOWN_WITHIN = (ReachedParameters, ReachedPositionParameters, TimeLimitParameters)
"""Oracles that need an event within their window: with an empty window they fail."""


def case_warnings(files: CaseFiles, setup: Setup, modes: tuple[Mode, ...]) -> Iterator[Problem]:
    """Yield warnings of a case for the flown modes: what is valid but probably not meant.

    A case with problems of its own may be given as well.
    """
    yield from document_warnings(files)
    for mode in modes:
        scene = setup.world.scene(mode, judged_world(mode))
        yield from _wide_fences(files.campaign, setup, mode, scene)
        yield from _near_goals(files.campaign, setup, mode, scene)
        yield from _without_objects(files.campaign, setup, scene)
        yield from _empty_worlds(files.campaign, setup, mode, scene)
        yield from _momentary_windows(files.campaign, setup, mode)
        yield from room_warnings(files.campaign, setup, scene)
    yield from simulated_actors(files.campaign, setup, modes)
    yield from _long_limits(files.campaign, setup)
    if "wil" in modes:
        yield from unmixed_objects(files, setup)
    yield from limit_warnings(files.campaign, setup)


def document_warnings(files: CaseFiles) -> Iterator[Problem]:
    """Yield warnings of the files of a case that need no setup: angles that look like radians."""
    for document in (files.campaign, files.world, files.recipe):
        if document is not None:
            yield from _radians(document, document.data)


def _unchecked_goals(files: CaseFiles, setup: Setup) -> Iterator[Problem]:
    """Yield a warning for a position and gates of the goal that no required oracle checks."""
    checked: set[str] = set()
    for use in setup.oracles:
        if isinstance(use.parameters, ReachedParameters) and use.parameters.required:
            checked.update(
                setup.goal.gates if use.parameters.gates is None else use.parameters.gates
            )
    for index, gate in enumerate(setup.goal.gates):
        if gate not in checked:
            message = f"no required oracle checks that gate '{gate}' of the goal is flown through"
            yield files.campaign.problem(("goal", "gates", index), message)
    required = {type(use.parameters) for use in setup.oracles if use.parameters.required}
    if setup.goal.position_ned_m is not None and ReachedPositionParameters not in required:
        message = (
            "no required oracle checks that the goal's position is reached: `reached_position`"
        )
        yield files.campaign.problem(("goal", "position"), message)


def caveats_of(files: CaseFiles, setup: Setup, modes: tuple[Mode, ...]) -> Iterator[Problem]:
    """Yield the warnings of a case that are also caveats of each of its verdicts."""
    yield from _unchecked_goals(files, setup)
    yield from _unperceived_mixture(files, setup, modes)
    if "wil" in modes:
        yield from wide_registration_limits(files, setup)
    yield from estimated_actors(files.campaign, setup, modes)
    for name in dict.fromkeys(FLIES[mode][0] for mode in modes):
        yield from _long_gaps(files.campaign, setup, name)


def _unperceived_mixture(
    files: CaseFiles, setup: Setup, modes: tuple[Mode, ...]
) -> Iterator[Problem]:
    """Yield a warning for a recipe that publishes no mixture to the vehicle that is judged."""
    if "wil" not in modes or setup.recipe is None or files.recipe is None:
        return
    reached = any("real" in one.publish for one in setup.recipe.combinations)
    if not reached and not setup.outside.injections:
        message = (
            "nothing is published to 'real': the vehicle judged in mode wil perceives no mixture"
        )
        yield files.recipe.problem(("combine",), message, key=True)


def _long_gaps(campaign: Document, setup: Setup, name: VehicleName) -> Iterator[Problem]:
    """Yield a warning for a judged vehicle whose positions may be missing for long."""
    vehicle = setup.vehicles.get(name)
    if vehicle is None:
        return
    path: Path = ("vehicles", name, "telemetry", "max_gap_s")
    gap_s = vehicle.max_gap_s
    if vehicle.pose_source == "mocap":
        path = ("vehicles", name, "mocap", "stall_s")
        gap_s = None if vehicle.mocap is None else vehicle.mocap.stall_s
    if gap_s is not None and gap_s > _LONG_GAP_S:
        message = f"positions of '{name}' may be missing for {gap_s:g} s"
        yield campaign.problem(path, f"{message}: its flight meanwhile is not judged")


def _radians(document: Document, value: Data, path: Path = ()) -> Iterator[Problem]:
    """Yield warnings for angles in degrees whose values look like radians."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _radians(document, inner, (*path, key))
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from _radians(document, inner, (*path, index))
    elif isinstance(value, float | int) and not isinstance(value, bool):
        key = next((one for one in reversed(path) if isinstance(one, str)), "")
        if key.endswith("_deg") and _looks_like_radians(key, float(value)):
            message = (
                f"{value:g} degrees? in radians that would be {math.degrees(value):.4g} degrees"
            )
            yield document.problem(path, message)


def _looks_like_radians(key: str, value: float) -> bool:
    """Return whether the value of a key in degrees deserves a warning: typical in radians."""
    if key == "fov_deg":
        return 0.0 < value < _NARROW_DEG
    parts = value / _PART
    near = abs(parts - round(parts)) * _PART < _AS_TYPED
    return near and 1 <= abs(round(parts)) <= 24 and value != round(value)


def _wide_fences(campaign: Document, setup: Setup, mode: Mode, scene: Scene) -> Iterator[Problem]:
    """Yield warnings for fences so much wider than the room that they do not limit the flight."""
    room_m = _room_size_m(scene)
    if room_m is None:
        return
    for name in FLIES[mode]:
        fence = setup.fences.get(name)
        if fence is not None and exceeds_room(wide_m := _width_m(fence), max(room_m)):
            message = (
                f"the fence is {wide_m:g} m wide, and the room {max(room_m):g} m: it limits nothing"
            )
            yield campaign.problem(("geofence",), message, key=True)


def _near_goals(campaign: Document, setup: Setup, mode: Mode, scene: Scene) -> Iterator[Problem]:
    """Yield warnings for goal positions that nearly any flight reaches."""
    target = setup.goal.position_ned_m
    subject = setup.vehicles.get(FLIES[mode][0])
    if target is None or subject is None:
        return
    north_m, east_m, _ = subject.start.position_ned_m
    away_m = norm(subtract(target, (north_m, east_m, -setup.goal.altitude_m)))
    room_m = _room_size_m(scene)
    for use in setup.oracles:
        given = use.parameters
        if not isinstance(given, ReachedPositionParameters):
            continue
        path: Path = ("oracles", use.name, "tolerance_m")
        within = f"within {given.tolerance_m:g} m counts as reached"
        if given.tolerance_m >= away_m:
            message = f"{within}, and the goal is {away_m:.3g} m from the hover: it cannot fail"
            yield campaign.problem(path, message)
        elif room_m is not None and given.tolerance_m >= min(room_m) / 2.0:
            yield campaign.problem(path, f"{within}, in a room of {min(room_m):g} m")


def _without_objects(campaign: Document, setup: Setup, scene: Scene) -> Iterator[Problem]:
    """Yield warnings for contact oracles that ignore every object of the world."""
    for use in setup.oracles:
        given = use.parameters
        left = set(scene.names) - set(getattr(given, "exclude", ()))
        if isinstance(given, ContactParameters) and scene.names and given.exclude and not left:
            message = f"oracle '{use.name}' excludes every object of the world: it cannot fail"
            yield campaign.problem(("oracles", use.name, "exclude"), message)


def _empty_worlds(campaign: Document, setup: Setup, mode: Mode, scene: Scene) -> Iterator[Problem]:
    """Yield a warning for a mode in whose judged world none of the world's objects exists."""
    if setup.world.objects and not scene.names:
        which = judged_world(mode)
        message = f"in mode {mode} no object of the world exists in {which}: no contact is possible"
        yield campaign.problem(("world",), f"{message} (see exists_in)")


def _momentary_windows(campaign: Document, setup: Setup, mode: Mode) -> Iterator[Problem]:
    """Yield warnings for windows that close when they open: from done to land, with one vehicle."""
    for use in setup.oracles:
        if isinstance(use.parameters, _SHOWN_WITHIN):
            continue
        if len(FLIES[mode]) == 1 and _window_of(use) == Window("done", "land"):
            message = (
                f"in mode {mode} the window of '{use.name}' closes when it opens: it cannot fail"
            )
            yield campaign.problem(("oracles", use.name), message, key=True)


def _long_limits(campaign: Document, setup: Setup) -> Iterator[Problem]:
    """Yield warnings for time limits beyond the time-out of their stage: they never apply."""
    for use in setup.oracles:
        given = use.parameters
        if not isinstance(given, TimeLimitParameters):
            continue
        longest_s, key = _longest_s(setup, _window_of(use))
        if given.limit_s >= longest_s:
            message = f"{key} ends the stage after {longest_s:g} s: it cannot fail"
            yield campaign.problem(("oracles", use.name, "limit_s"), message)


def _window_of(use: OracleUse) -> Window | None:
    """Return the window in which an oracle judges; None where its parameters are no window."""
    usual = registry[use.kind].window
    try:
        return use.parameters.window(usual) if isinstance(use.parameters, Windowed) else usual
    except ValueError:
        return None


def _longest_s(setup: Setup, window: Window | None) -> tuple[float, str]:
    """Return the longest time between two stages of a run, and the key of the time-out."""
    sync = setup.sync
    bounded: dict[Window | None, tuple[float, str]] = {
        Window("takeoff", "at_height"): (sync.takeoff_timeout_s, "sync.takeoff_timeout_s"),
        Window("goal", "done"): (sync.goal_timeout_s, "sync.goal_timeout_s"),
        Window("land", "landed"): (sync.landing_timeout_s, "sync.landing_timeout_s"),
    }
    return bounded.get(window, (math.inf, ""))


def _room_size_m(scene: Scene) -> tuple[float, float] | None:
    """Return length and width of the largest room, to warn of wide fences; None without one."""
    return max((size_m for size_m, _ in rooms(scene)), default=None, key=max)


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
