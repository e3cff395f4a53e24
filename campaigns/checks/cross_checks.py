"""Checks across the files of a case: campaign, world and recipe; pure.

Checks of actors, vehicles that fly as objects of the world: fences, places, separation; pure.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Sized
from pathlib import PurePath
from typing import Self

from wil_campaign.campaigns.checks.external_checks import external_problems
from wil_campaign.campaigns.checks.mixing_checks import mixing_problems
from wil_campaign.campaigns.checks.place_checks import judged_world, place_problems
from wil_campaign.campaigns.checks.vehicle_checks import vehicle_problems
from wil_campaign.campaigns.schema import Mode
from wil_campaign.campaigns.setup.actor_setups import ActorSetup
from wil_campaign.campaigns.setup.case_files import CaseFiles
from wil_campaign.campaigns.setup.case_setup import FLIES, Case, GoalSetup
from wil_campaign.campaigns.setup.encounters import actor_encounters
from wil_campaign.foundation.files.documents import Document, Path, Problem, closest_word
from wil_campaign.foundation.files.documents import Path as KeyPath
from wil_campaign.safety.evaluation.judge import OracleUse, build_oracles
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.guard.core.setpoint_limits import SetpointLimits
from wil_campaign.safety.oracles.oracle import Oracle, OracleContext, OracleError
from wil_campaign.safety.oracles.registry import oracle_kinds
from wil_campaign.worlds.figures import distinct_value_text
from wil_campaign.worlds.frames import Vec3
from wil_campaign.worlds.world_file.world import World


def actor_problems(files: CaseFiles, case: Case, mode: Mode) -> Iterator[Problem]:
    """Yield the problems of a mode's actors: cameras, fences, places, what they could touch."""
    yield from _foreign_cameras(files, case)
    yield from _unplaced(files, case, mode)
    for actor in case.actors_in(mode):
        fence = case.fences.get(actor.name)
        if fence is not None:
            yield from _way_outside_fence(files, case, actor, fence)
        if actor.attached is not None:
            yield from _unfit_return(files, actor)
    yield from _near_misses(files, case, mode)


def _foreign_cameras(files: CaseFiles, case: Case) -> Iterator[Problem]:
    """Yield cameras whose images a simulator renders: it moves an actor's object by itself."""
    if not case.actors:
        return
    actor = next(iter(case.actors))
    for vehicle in case.vehicles.values():
        for camera in vehicle.cameras:
            if camera.source is not None and camera.source.renders_on_request:
                message = (
                    f"the simulator of this camera does not receive the position of the actor "
                    f"'{actor}'; remove `source`, or the actor"
                )
                path = ("vehicles", vehicle.name, "sensors", camera.name, "source")
                yield files.campaign.problem(path, message)


def _unplaced(files: CaseFiles, case: Case, mode: Mode) -> Iterator[Problem]:
    """Yield attached actors of a mode in which their object is virtual and nothing may fly it."""
    flown = {one.name for one in case.actors_in(mode)}
    virtual = set(case.world.scene(mode, "Wv").names)
    for name, actor in case.actors.items():
        if name in virtual and name not in flown:
            message = (
                f"in mode {mode} '{name}' is virtual, but an attached vehicle is physical; write "
                "`virtual: embedded` to fly an embedded vehicle instead, or "
                "`virtual: {place: {north_m: ..., east_m: ...}}` to fly this one at another place"
            )
            yield files.campaign.problem((*actor.path, "link"), message)


def _way_outside_fence(
    files: CaseFiles, case: Case, actor: ActorSetup, fence: Fence
) -> Iterator[Problem]:
    """Yield the start and the waypoints of an actor that are outside its own fence, or too near."""
    path: KeyPath = (*actor.path, "geofence")
    places: list[tuple[str, Vec3, Fence | None]] = [
        ("starts", actor.start.position_ned_m, fence.without_floor()),
        *(
            (f"has waypoint {index}", waypoint.position_ned_m, fence)
            for index, waypoint in enumerate(actor.motion.waypoints)
        ),
    ]
    for what, place, keeping in places:
        if keeping is None:
            continue
        margin_m, keep_m = keeping.margin_m(place), case.guarding.keep_m
        side = keeping.boundary(place)
        if margin_m < 0.0:
            message = f"'{actor.name}' {what} {-margin_m:.2f} m outside of its geofence's {side}"
        elif margin_m < keep_m:
            message = (
                f"'{actor.name}' {what} {distinct_value_text(margin_m, keep_m)} m from its "
                f"geofence's {side}, nearer than keep_m {keep_m:g}"
            )
        else:
            continue
        yield files.campaign.problem(path, message, key=True)


def _unfit_return(files: CaseFiles, actor: ActorSetup) -> Iterator[Problem]:
    """Yield `fly_back` between runs where an attached actor has to be returned by a person."""
    if files.campaign.get(("between_runs", "do")) == "fly_back":
        message = (
            f"flies only 'real' back; a person has to return the attached actor '{actor.name}' to "
            "its start: write ask"
        )
        yield files.campaign.problem(("between_runs", "do"), message)


def _near_misses(files: CaseFiles, case: Case, mode: Mode) -> Iterator[Problem]:
    """Yield attached actors that could touch another attached vehicle."""
    for encounter in actor_encounters(case, mode):
        if encounter.is_far or (
            encounter.may_be_allowed and "separation" in case.preflight.override
        ):
            continue
        if encounter.other_fence is None:
            message = (
                f"in mode {mode} '{encounter.actor.name}' flies beside '{encounter.other.name}', "
                "which is also attached and has no geofence: nothing keeps the two apart; give it "
                "a geofence"
            )
        else:
            message = (
                f"in mode {mode} this fence is {encounter.apart_m:.2f} m from that of "
                f"'{encounter.other.name}', also attached: the two can touch; leave "
                f"{encounter.needed_m:.2f} m between the fences, seen from above, "
                f"{encounter.remedy}"
            )
        yield files.campaign.problem((*encounter.actor.path, "geofence"), message, key=True)


Check = Callable[[CaseFiles, Case, Mode], Iterator[Problem]]


def cross_problems(files: CaseFiles, case: Case, modes: tuple[Mode, ...]) -> list[Problem]:
    """Return the problems across a case's files (campaign, recipe, world) for the flown modes.

    A mode whose vehicle is missing has that problem alone; nothing else of it is checked.
    """
    return _problems(_CHECKS, files, case, modes)


def worldless_problems(files: CaseFiles, case: Case, modes: tuple[Mode, ...]) -> list[Problem]:
    """Return the problems across a case's files that do not depend on its world's objects.

    For a case whose world is missing or faulty; the setup has an empty world in its place.
    """
    return _problems(_WORLDLESS_CHECKS, files, case, modes)


def _problems(
    checks: tuple[Check, ...], files: CaseFiles, case: Case, modes: tuple[Mode, ...]
) -> list[Problem]:
    problems: list[Problem] = []
    for mode in modes:
        missing = list(_missing_vehicles(files, case, mode))
        problems += missing
        for check in checks if not missing else ():
            problems += check(files, case, mode)
    return problems


def _missing_vehicles(files: CaseFiles, case: Case, mode: Mode) -> Iterator[Problem]:
    """Yield a problem for each vehicle that a mode needs and the campaign lacks."""
    for name in FLIES[mode]:
        if name not in case.vehicles:
            path = ("vehicles", name)
            yield files.campaign.problem(path, f"mode {mode} needs a vehicle '{name}'", key=True)


def _gates(files: CaseFiles, case: Case, mode: Mode) -> Iterator[Problem]:
    """Yield goal gates without an opening, or missing from the world in which a run is judged."""
    which = judged_world(mode)
    scene = case.world.scene(mode, which)
    for index, gate in enumerate(case.goal.gates):
        path: Path = ("goal", "gates", index)
        if gate not in case.world.objects:
            yield _no_object(files.campaign, path, gate, case.world)
        elif gate not in scene:
            yield files.campaign.problem(path, _absence(files, mode, gate))
        elif not scene[gate].shape.openings:
            message = f"'{gate}' is a {scene[gate].shape.kind}, which has no opening to fly through"
            open_ones = [thing.name for thing in scene.objects if thing.shape.openings]
            yield files.campaign.problem(path, message, closest_word(gate, open_ones))


def _no_object(document: Document, path: Path, name: str, world: World) -> Problem:
    """Return the problem that the world has no object of this name."""
    return document.problem(
        path, f"no object '{name}' in the world", closest_word(name, world.objects)
    )


def _oracles(files: CaseFiles, case: Case, mode: Mode) -> Iterator[Problem]:
    """Check a case's oracles across its files by building each against an empty world.

    A gate that the world lacks counts as present here: `_gates` reports it, once, at the goal.
    """
    scene = case.world.scene(mode, judged_world(mode))
    openings = [thing.name for thing in scene.objects if thing.shape.openings]
    contexts = _contexts(case, mode, scene.names, (*openings, *case.goal.gates))
    built: list[tuple[OracleUse, tuple[Oracle, ...]]] = []
    for use in case.oracles:
        yield from _unknown_names(files.campaign, use, case.world)
        try:
            built.append((use, build_oracles([use], contexts)))
        except OracleError as error:
            of_world = _contexts(case, mode, case.world.objects, (*openings, *case.goal.gates))
            absent = _absent_objects(use, case, scene.names, of_world)
            if absent:
                reasons = "; ".join(_absence(files, mode, name) for name in absent)
                message = f"oracle {use.name!r}: {reasons}"
                error = OracleError(message, key=error.key, offset=error.offset)
            yield _oracle_problem(files.campaign, use.name, error)
    if len(built) == len(_oracles_in_file(files.campaign)):
        yield from _unjudged_goals(files.campaign, case, mode, built)


def _absent_objects(
    use: OracleUse,
    case: Case,
    there: Collection[str],
    of_world: dict[str, OracleContext],
) -> list[str]:
    """Return the objects without which an oracle cannot be built: in the file, not in the scene.

    of_world: contexts in which every object of the file is there; empty where it fails in these.
    """
    try:
        build_oracles([use], of_world)
    except OracleError:
        return []
    named = oracle_kinds()[use.kind].objects(use.parameters, case.world.objects)
    return [name for name in named if name not in there]


def _absence(files: CaseFiles, mode: Mode, name: str) -> str:
    """Return that an object of the world file is not in the judged world, and which line says so.

    The line is the case's where the case takes the object away.
    """
    message = f"'{name}' is not in {judged_world(mode)} in mode {mode}"
    at: Path = ("objects", name, "exists_in")
    if files.world is None or files.world.get(at) is None:
        return f"{message} (see its exists_in)"
    place = files.world.entry(at).node.place
    where = f"{PurePath(place.source.name).name}:{place.line}"
    return f"{message} (see its exists_in, {where if place.source.lines else place.source.name})"


def _formulas(files: CaseFiles, case: Case, mode: Mode) -> Iterator[Problem]:
    """Check oracles without a world where they can be: an object that one names is there."""
    for use in case.oracles:
        named = oracle_kinds()[use.kind].without_world
        if named is None:
            continue
        contexts = _contexts(case, mode, named(use.parameters), ())
        try:
            build_oracles([use], contexts)
        except OracleError as error:
            yield _oracle_problem(files.campaign, use.name, error)


def _contexts(
    case: Case, mode: Mode, things: tuple[str, ...], gates: Iterable[str]
) -> dict[str, OracleContext]:
    """Return the contexts of oracles in an empty world, to check that they can be built."""
    return {
        name: OracleContext(
            mode=mode,
            subject=FLIES[mode][0],
            vehicle=name,
            start=case.vehicles[name].start,
            probe=_NothingNear(),
            things=things,
            probe_of=lambda _: _NothingNear(),
            gates={gate: _AnyGate() for gate in gates},
            route=case.goal.gates,
            target_ned_m=case.goal.position_ned_m,
            fence=case.fences.get(name),
            frame=case.world.frame,
        )
        for name in FLIES[mode]
    }


def _oracle_problem(file: Document, name: str, error: OracleError) -> Problem:
    path: Path = ("oracles", name, *((error.key,) if error.key else ()))
    if error.offset is not None:
        return file.problem_within(path, error.offset, str(error), error.suggestion)
    return file.problem(path, str(error), error.suggestion, key=not error.key)


def _oracles_in_file(file: Document) -> Sized:
    """Return the campaign's oracles as the file has them, those with errors of their own too."""
    oracles = file.get(("oracles",))
    return oracles if isinstance(oracles, dict) else ()


def _unjudged_goals(
    file: Document,
    case: Case,
    mode: Mode,
    built: Iterable[tuple[OracleUse, tuple[Oracle, ...]]],
) -> Iterator[Problem]:
    """Yield what no oracle judges in a mode: the flight as a whole, or reaching the goal."""
    subject = FLIES[mode][0]
    judging = [
        (use.kind, oracle.required)
        for use, oracles in built
        for oracle in oracles
        if oracle.name == use.name
        and subject in oracle.watches
        and oracle.required == use.parameters.required
    ]
    if not any(required for _, required in judging):
        message = (
            f"in mode {mode} no required oracle judges '{subject}': nearly any flight would pass"
        )
        yield file.problem(("oracles",), message, key=True)
    wanted = (
        ("gates", "reached", "{}", bool(case.goal.gates)),
        (
            "position",
            "reached_position",
            "{tolerance_m: 0.3}",
            case.goal.position_ned_m is not None,
        ),
    )
    for key, kind, parameters, given in wanted:
        if given and all(kind != one for one, _ in judging):
            message = f"in mode {mode} no oracle judges whether '{subject}' reaches it; add"
            hint = f"'{kind}: {parameters}', with 'required: false' to report it only"
            yield file.problem(("goal", key), f"{message} {hint}", key=True)


def _unknown_names(file: Document, use: OracleUse, world: World) -> Iterator[Problem]:
    """Yield oracle parameters that name objects missing from the world: `gate`, `gate.left`."""
    for key in ("exclude", "ground"):
        for index, name in enumerate(getattr(use.parameters, key, ())):
            if name.partition(".")[0] not in world.objects:
                yield _no_object(file, ("oracles", use.name, key, index), name, world)


def _limits(files: CaseFiles, case: Case, mode: Mode) -> Iterator[Problem]:
    """Yield a goal beyond the heights of `limits`, and a geofence that they need and lack."""
    if case.limits is None:
        return
    yield from _goal_beyond_limits(files, case.goal, case.limits)
    if not case.limits.inside_fence:
        return
    for name in FLIES[mode]:
        if name not in case.fences:
            whose = "the campaign" if not case.fences else f"'{name}'"
            message = f"needs a geofence; {whose} has none"
            yield files.campaign.problem(("limits", "inside_geofence"), message)


def _goal_beyond_limits(
    files: CaseFiles, goal: GoalSetup, limits: SetpointLimits
) -> Iterator[Problem]:
    """Yield a goal to which no setpoint may lead; a takeoff is no setpoint, and goes beyond."""
    low_m, high_m = limits.floor_up_m, limits.ceiling_up_m
    if low_m is None or high_m is None:
        return
    heights_m: dict[Path, float] = {("goal", "altitude_m"): goal.altitude_m}
    if goal.position_ned_m is not None:
        heights_m["goal", "position"] = -goal.position_ned_m[2]
    for path, up_m in heights_m.items():
        if not low_m + limits.keep_m <= up_m <= high_m - limits.keep_m:
            message = f"is not within limits.up_m [{low_m:g}, {high_m:g}] by keep_m"
            yield files.campaign.problem(path, f"{message} {limits.keep_m:g}")


class _NothingNear:
    """A clearance probe of an empty world, to check that oracles can be built."""

    def reaching(self, _: float) -> Self:
        """Return this probe: nothing is near, however far it looks."""
        return self

    def above(self, _: float) -> Self:
        """Return this probe: the ground is not near either."""
        return self

    def sweep(self, *_: object, **__: object) -> tuple[()]:
        """Return no clearance: nothing is near in the empty world of the check."""
        return ()


class _AnyGate:
    """A gate that no vehicle flies through, to check that oracles can be built."""

    limit_m = 1.0

    def crossing(self, *_: object) -> None:
        """Return None: the gate of the check is never crossed."""

    def depth_m(self, *_: object) -> float:
        """Return a constant depth: the vehicle stays before the gate of the check."""
        return -1.0


_CHECKS: tuple[Check, ...] = (
    vehicle_problems,
    actor_problems,
    mixing_problems,
    _gates,
    place_problems,
    _oracles,
    external_problems,
    _limits,
)
_WORLDLESS_CHECKS: tuple[Check, ...] = (vehicle_problems, place_problems, _formulas, _limits)
