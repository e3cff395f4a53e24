"""Check starts, goals and gates of a case against its fences, rooms and objects; pure."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Literal

from wil_campaign.campaigns.schema import Mode, VehicleName
from wil_campaign.campaigns.setup.case_files import CaseFiles
from wil_campaign.campaigns.setup.case_setup import FLIES, Case, VehicleSetup
from wil_campaign.foundation.files.documents import Path, Problem
from wil_campaign.safety.fence.onboard_areas import onboard_areas, stored_items
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.embedded.physics.airframe import Airframe
from wil_campaign.worlds.clearance.clearance import ClearanceProbe
from wil_campaign.worlds.figures import distinct_value_text
from wil_campaign.worlds.frames import Vec3
from wil_campaign.worlds.scene.scene import Scene, SceneObject

Which = Literal["W", "Wv"]

SEES: dict[tuple[Mode, VehicleName], tuple[Which, ...]] = {
    ("sim", "twin"): ("Wv",),
    ("wil", "real"): ("W", "Wv"),
    ("wil", "twin"): ("Wv",),
    ("real", "real"): ("W",),
}
"""In which worlds a vehicle is, by mode: the real one in W and, in mode wil, also in Wv."""

_ON_FLOOR_M = 0.05
"""How far below the floor of a room a vehicle may stand before it counts as outside."""


_STANDS_M = Airframe().leg_height_m
"""How far the middle of a body is above the ground when it stands, at least."""
_NEAR_M = 0.1
_FAR_M = 100.0
"""A gate farther outside of the fence is misplaced in its world, as by lengths in millimetres."""


def judged_world(mode: Mode) -> Which:
    """Return the world, real (W) or virtual (Wv), against which the runs of a mode are judged."""
    return "W" if mode == "real" else "Wv"


def place_problems(files: CaseFiles, case: Case, mode: Mode) -> Iterator[Problem]:
    """Yield impossible places of one mode: starts, goals and gates against fences and rooms.

    Of a vehicle whose start is outside of the fence, only that and its takeoff are reported.
    """
    for (flown, name), worlds in SEES.items():
        if flown != mode:
            continue
        vehicle = case.vehicles[name]
        outside = list(_start_outside_fence(files, case, vehicle))
        yield from outside
        for which in worlds if not outside else ():
            scene = case.world.scene(mode, which)
            yield from _start_outside_room(files, vehicle, scene)
            yield from _start_in_object(files, vehicle, scene)
            yield from _goal_above_room(files, case, vehicle, scene)
        yield from _start_below_ground(files, case, vehicle)
        if not outside:
            yield from _goal_outside_fence(files, case, vehicle)
        yield from _no_takeoff(files, case, vehicle)
    yield from _gates_outside_fence(files, case, mode)
    yield from large_fences(files, case, mode, embedded=True)


def large_fences(files: CaseFiles, case: Case, mode: Mode, *, embedded: bool) -> Iterator[Problem]:
    """Yield fences with more corners than the autopilots of a mode's vehicles store.

    embedded: those that do so for certain; others may have more memory.
    """
    pair = [case.vehicles[name] for name in FLIES[mode] if name in case.vehicles]
    flown = [one for one in pair if mode != "wil" or one.coupling != "placed"]
    for vehicle in (*flown, *case.actors_in(mode)):
        fence, onboard = case.fences.get(vehicle.name), case.preflight.fence
        autopilot = autopilot_named(vehicle.autopilot)
        most = autopilot.most_fence_items
        if vehicle.embedded is not embedded or fence is None or onboard is None or most is None:
            continue
        north_m, east_m, _ = vehicle.start.position_ned_m
        count = stored_items(onboard_areas(fence, onboard.margin_m, (north_m, east_m)))
        if count > most:
            is_actor = vehicle.name in case.actors
            path: Path = (*vehicle.path, "geofence") if is_actor else ("geofence",)
            message = (
                f"{autopilot.label} of '{vehicle.name}' stores {most} corners and circles, and its "
                f"fence has {count} of them, {onboard.margin_m:g} m wider: simplify the areas, or "
                "write preflight: {fence: null}, and only the guard and the oracle have it"
            )
            yield files.campaign.problem(path, message, key=True)


def _start_outside_fence(files: CaseFiles, case: Case, vehicle: VehicleSetup) -> Iterator[Problem]:
    """Yield a problem when a vehicle's start place lies outside its fence."""
    if deviation := _deviation(case, vehicle, vehicle.start.position_ned_m):
        path = ("vehicles", vehicle.name, "start")
        yield files.campaign.problem(path, f"'{vehicle.name}' starts {deviation}", key=True)


def _goal_outside_fence(files: CaseFiles, case: Case, vehicle: VehicleSetup) -> Iterator[Problem]:
    """Yield a problem when the hover above the start, or the goal's place, leaves the fence."""
    north_m, east_m, _ = vehicle.start.position_ned_m
    hover: Vec3 = (north_m, east_m, -case.goal.altitude_m)
    wanted: list[tuple[Path, Vec3 | None]] = [
        (("goal", "altitude_m"), hover),
        (("goal", "position"), case.goal.position_ned_m),
    ]
    for path, place in wanted:
        if place is not None and (deviation := _deviation(case, vehicle, place)):
            yield files.campaign.problem(path, f"is {deviation}")


def _no_takeoff(files: CaseFiles, case: Case, vehicle: VehicleSetup) -> Iterator[Problem]:
    """Yield a takeoff height that is not above the start place, or within the tolerance of it."""
    up_m = -vehicle.start.position_ned_m[2]
    climb_m = case.goal.altitude_m - up_m
    if climb_m <= 0.0:
        message = f"is not above the start of '{vehicle.name}', {up_m:g} m up"
        yield files.campaign.problem(("goal", "altitude_m"), message)
    elif climb_m <= case.sync.takeoff_tolerance_m:
        reason = f"the tolerance of {case.sync.takeoff_tolerance_m:g} m is met on the ground"
        message = f"'{vehicle.name}' climbs by {climb_m:g} m: {reason}"
        yield files.campaign.problem(("sync", "takeoff_tolerance_m"), message)


def _gates_outside_fence(files: CaseFiles, case: Case, mode: Mode) -> Iterator[Problem]:
    """Yield static gates whose centre lies outside a fence."""
    scene = case.world.scene(mode, judged_world(mode))
    for index, name in enumerate(case.goal.gates):
        if name not in scene or scene[name].motion is not None:
            continue
        pose = scene[name].pose
        middles = [pose.compose(opening.pose) for opening in scene[name].shape.openings]
        middle = (*middles, pose)[0].position_ned_m
        for flown, vehicle in SEES:
            if flown == mode and (deviation := _deviation(case, case.vehicles[vehicle], middle)):
                fence, at = case.fences[vehicle], ("objects", name, "pose")
                message = f"'{name}' is {deviation}"
                if files.world is None or files.world.get(at) is None:
                    yield files.campaign.problem(("goal", "gates", index), message)
                elif fence.margin_m(middle) < -_FAR_M:
                    yield files.world.problem(at, f"{message}: lengths are in metres", key=True)
                else:
                    yield files.campaign.problem(("goal", "gates", index), message)


def _deviation(case: Case, vehicle: VehicleSetup, place: Vec3) -> str:
    """Return how far a place is outside a vehicle's fence, or too near to it; "" for a good one."""
    fence = case.fences.get(vehicle.name)
    if fence is None:
        return ""
    margin_m, keep_m = fence.margin_m(place), case.guarding.keep_m
    side = fence.boundary(place)
    if margin_m < 0.0:
        return f"{-margin_m:.2f} m outside of the geofence's {side}"
    if margin_m < keep_m:
        near_m = distinct_value_text(margin_m, keep_m)
        return f"{near_m} m from the geofence's {side}, nearer than keep_m {keep_m:g}"
    return ""


def _start_outside_room(files: CaseFiles, vehicle: VehicleSetup, scene: Scene) -> Iterator[Problem]:
    """Yield a problem when the start place lies in none of the world's rooms."""
    start = vehicle.start.position_ned_m
    rooms = [thing for thing in scene.objects if thing.is_room]
    if rooms and not any(_room_height_m(room, start) is not None for room in rooms):
        names = " and ".join(f"'{room.name}'" for room in rooms)
        message = f"'{vehicle.name}' starts outside room {names}"
        yield files.campaign.problem(("vehicles", vehicle.name, "start"), message, key=True)


def _start_below_ground(files: CaseFiles, case: Case, vehicle: VehicleSetup) -> Iterator[Problem]:
    """Yield a problem when the start place lies below the ground that the world file states."""
    ground_down_m, down_m = case.world.ground_down_m, vehicle.start.position_ned_m[2]
    if ground_down_m is not None and down_m > ground_down_m + _ON_FLOOR_M:
        depth_m = down_m - ground_down_m
        message = f"'{vehicle.name}' starts {depth_m:g} m below the world's ground (ground_up_m)"
        yield files.campaign.problem(("vehicles", vehicle.name, "start"), message, key=True)


def _start_in_object(files: CaseFiles, vehicle: VehicleSetup, scene: Scene) -> Iterator[Problem]:
    """Yield the world's objects that overlap the vehicle at its start place."""
    probe = ClearanceProbe(scene, vehicle.body, floors=False, within_m=_NEAR_M)
    stands_m = max(_STANDS_M, vehicle.body.half_m[2])
    north_m, east_m, down_m = vehicle.start.position_ned_m
    standing = replace(vehicle.start, position_ned_m=(north_m, east_m, down_m - stands_m))
    for clearance in probe.sweep(standing, 0.0, standing, 0.0):
        if clearance.clearance_m <= 0.0:
            message = f"'{vehicle.name}' starts inside '{clearance.object_name}'"
            yield files.campaign.problem(("vehicles", vehicle.name, "start"), message, key=True)


def _goal_above_room(
    files: CaseFiles, case: Case, vehicle: VehicleSetup, scene: Scene
) -> Iterator[Problem]:
    """Yield a problem when the goal lies above the ceiling of the room around the start."""
    start = vehicle.start.position_ned_m
    for room in scene.objects:
        height_m = _room_height_m(room, start) if room.is_room else None
        ceiled = any(part.name == "ceiling" for part in room.shape.parts)
        floor_up_m = -room.pose.position_ned_m[2]
        if height_m is not None and ceiled and case.goal.altitude_m - floor_up_m >= height_m:
            message = (
                f"is not below the ceiling of room '{room.name}', {floor_up_m + height_m:g} m up"
            )
            yield files.campaign.problem(("goal", "altitude_m"), message)


def _room_height_m(room: SceneObject, point_m: Vec3) -> float | None:
    """Return the height of a room that contains a place; None when the place is outside."""
    low, high = room.shape.mesh.vertices_m.min(axis=0), room.shape.mesh.vertices_m.max(axis=0)
    forward_m, right_m, down_m = room.pose.to_local(point_m)
    inside = (
        low[0] < forward_m < high[0]
        and low[1] < right_m < high[1]
        and low[2] < down_m < high[2] + _ON_FLOOR_M
    )
    return float(high[2] - low[2]) if inside else None
