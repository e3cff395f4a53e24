"""Warnings of `validate`: what is valid in the files of a case, but probably not meant; pure."""

import math
from collections.abc import Iterator

from wil_campaign.campaigns.checks.hidden_objects import hidden_object_warnings
from wil_campaign.campaigns.checks.mixture_warnings import (
    nothing_isolated_warnings,
    nothing_real_warnings,
    wide_registration_warnings,
)
from wil_campaign.campaigns.checks.place_checks import judged_world
from wil_campaign.campaigns.schema import VEHICLES, Mode, VehicleName
from wil_campaign.campaigns.setup.case_files import CaseFiles
from wil_campaign.campaigns.setup.case_setup import FLIES, Case
from wil_campaign.foundation.files.documents import Document, Path, Problem
from wil_campaign.hooks import case_hints
from wil_campaign.installed_plugins import load_plugin_object, plugin_additions
from wil_campaign.safety.fence.fence_files import fence_warnings
from wil_campaign.safety.oracles.goal import ReachedPositionParameters
from wil_campaign.safety.oracles.reached import ReachedParameters
from wil_campaign.safety.oracles.registry import oracle_kinds
from wil_campaign.worlds.figures import distinct_value_text
from wil_campaign.worlds.frames import rotate
from wil_campaign.worlds.scene.parts import ObjectOpening
from wil_campaign.worlds.scene.scene import Scene, SceneObject

_LEAST_LEVEL = 0.5
"""Of a gate's forward axis: with less of it level, the gate is flown through upwards or down."""
_LONG_GAP_S = 1.0
"""In a longer gap between positions, a vehicle that brakes at 3 m/s^2 deviates from the straight
line by more than 0.4 m: a dt^2 / 8."""


def case_warnings(files: CaseFiles, case: Case, modes: tuple[Mode, ...]) -> Iterator[Problem]:
    """Yield warnings of a case for the flown modes: what is valid but probably not meant.

    A case with problems of its own may be given as well.
    """
    yield from document_warnings(files)
    yield from _unread_parameters(files.campaign, case)
    yield from _unfenced_vehicles(files.campaign, case, modes)
    for hints in plugin_additions(case_hints).values():
        yield from load_plugin_object(hints.warnings)(files, case, modes)


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
    yield from _estimated_actors(files.campaign, case, modes)
    for mode in modes:
        scene = case.world.scene(mode, judged_world(mode))
        yield from _narrow_gates(files.campaign, case, mode, scene)
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


def _estimated_actors(file: Document, case: Case, modes: tuple[Mode, ...]) -> Iterator[Problem]:
    """Yield a warning for an actor whose object is placed by the actor's own position estimate."""
    estimated = dict.fromkeys(
        actor.name
        for mode in modes
        for actor in case.actors_in(mode)
        if actor.pose_source == "mavlink"
    )
    for name in estimated:
        message = (
            f"'{name}' is drawn and judged at its own position estimate: without ground truth the "
            "error of the estimate is unknown"
        )
        yield file.problem(("actors", name), message, key=True)


def _narrow_gates(file: Document, case: Case, mode: Mode, scene: Scene) -> Iterator[Problem]:
    """Yield a warning for each gate of the goal that is narrower than the judged vehicle's body."""
    vehicle = case.vehicles.get(FLIES[mode][0])
    for index, gate in enumerate(case.goal.gates if vehicle is not None else ()):
        if vehicle is None or gate not in scene or not scene[gate].shape.openings:
            continue  # a problem of the campaign
        width_m = 2.0 * vehicle.body.half_m[1]
        free_m = max(_level_width_m(scene[gate], each) for each in scene[gate].shape.openings)
        if width_m >= free_m:
            body = f"the body of '{vehicle.name}' is {width_m:g} m wide"
            message = (
                f"'{gate}' is open {distinct_value_text(free_m, width_m)} m across, and {body}"
            )
            path: Path = ("goal", "gates", index)
            yield file.problem(path, f"{message}: it does not fly through level")


def _level_width_m(thing: SceneObject, opening: ObjectOpening) -> float:
    """Return how wide an opening is beside the level way through it.

    One that is flown through upwards has no such way: the largest distance of its corners.
    """
    if opening.form == "ring":
        return 2.0 * opening.limit_m
    half_m = opening.limit_m
    square = ((-half_m, -half_m), (half_m, -half_m), (half_m, half_m), (-half_m, half_m))
    pose = thing.pose.compose(opening.pose)
    places = [pose.to_parent((0.0, *corner)) for corner in opening.corners_m or square]
    north, east, _ = rotate(pose.q_wxyz, (1.0, 0.0, 0.0))
    if math.hypot(north, east) < _LEAST_LEVEL:
        return max(math.dist(one, other) for one in places for other in places)
    aside_m = [(place[1] * north - place[0] * east) / math.hypot(north, east) for place in places]
    return max(aside_m) - min(aside_m)


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
