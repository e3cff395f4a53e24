"""Read the setup of one case from its files, and report the problems of all of them at once."""

import itertools
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel

from wil_campaign.campaigns.checks.autonomy_checks import (
    AutonomyTrial,
    IsolatedBuilds,
    autonomy_problems,
    try_autonomy,
)
from wil_campaign.campaigns.checks.case_warnings import case_warnings, document_warnings
from wil_campaign.campaigns.checks.cross_checks import cross_problems, worldless_problems
from wil_campaign.campaigns.schema import (
    CampaignPart,
    GoalPart,
    Mode,
    VehicleName,
    campaign_model,
)
from wil_campaign.campaigns.schema.autonomy import AutonomyPart
from wil_campaign.campaigns.schema.operator import GcsPart
from wil_campaign.campaigns.setup.actor_setups import actor_fences, actor_setups
from wil_campaign.campaigns.setup.autonomy_under_test import ForeignAutonomy, UnderTest
from wil_campaign.campaigns.setup.case_files import CaseFiles
from wil_campaign.campaigns.setup.case_setup import (
    Case,
    GoalSetup,
    GuardingSetup,
    ObserverSetup,
    SyncSetup,
)
from wil_campaign.campaigns.setup.fault_setups import fault_setups
from wil_campaign.campaigns.setup.oracle_uses import oracle_uses
from wil_campaign.campaigns.setup.vehicle_fences import FenceDrawing, fences_of_vehicles
from wil_campaign.campaigns.setup.vehicle_setups import vehicle_setups
from wil_campaign.foundation.files.documents import BadInput, Document, Problem, check_document
from wil_campaign.hooks import autonomy_kinds, run_observers
from wil_campaign.installed_plugins import load_plugin_object, plugin_additions
from wil_campaign.recipes.language.recipe_document import RecipePart, load_recipe
from wil_campaign.recipes.model.registry import registered_steps
from wil_campaign.safety.evaluation.judge import OracleUse
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.oracles.goal import TimeLimitParameters
from wil_campaign.safety.oracles.registry import oracle_kinds
from wil_campaign.vehicles.autopilots.registry import autopilot_strategies
from wil_campaign.vehicles.coupling import LIMITS_M
from wil_campaign.vehicles.embedded.autopilot.known_parameters import known_parameters
from wil_campaign.vehicles.embedded.profile import Profile
from wil_campaign.worlds.geodesy import LocalFrame
from wil_campaign.worlds.world_file.world import World
from wil_campaign.worlds.world_file.world_schema import WorldModel

T = TypeVar("T")

_GOAL_S = 600.0
_GRACE_S = 1.0
"""The default time-out of a goal: ten minutes, or longer than the longest `time_limit`."""

_NOWHERE = World("", LocalFrame(0.0, 0.0, 0.0), ())
"""Replaces a world that is missing, so that the rest of a case can be checked."""


def read_setup(
    files: CaseFiles,
    modes: tuple[Mode, ...],
    *,
    builds: IsolatedBuilds | None = None,
    loads_code: bool = True,
) -> Case:
    """Return the setup of a case, valid for these modes. Raises BadInput with every problem.

    builds: tries the autonomy in a child process, for a limited time; None: in this one.
    loads_code: whether the autonomy and the user's own steps are loaded to check them.
    """
    problems: list[Problem] = []
    files = files.without_cases
    part = collect_problems(problems, partial(check_document, files.campaign, campaign_model()))
    uses, oracle_problems = oracle_uses(files.campaign)
    problems += oracle_problems
    world = _read_case(World.parse, files.world, problems)
    recipe = _read_case(partial(load_recipe, loads_code=loads_code), files.recipe, problems)
    trial = AutonomyTrial()
    if part is not None and loads_code:
        # Reported also where the world is missing.
        under_test = _under_test(files, part)
        trial = try_autonomy(under_test, builds)
        problems += autonomy_problems(files.campaign, under_test, trial)
    if part is None:
        raise BadInput(problems, document_warnings(files))
    vehicles = vehicle_setups(files.campaign, part.vehicles, problems)
    ids: dict[str, int] = {name: vehicle.system_id for name, vehicle in vehicles.items()}
    fences = _fences(files, part, world, problems)
    setup = Case(
        vehicles=vehicles,
        actors={}
        if world is None
        else actor_setups(files.campaign, part.actors, world, ids, problems),
        world=world or _NOWHERE,
        recipe=recipe,
        under_test=_under_test(files, part),
        unread=trial.unread,
        goal=_goal(part.goal),
        sync=_sync(part, uses),
        fences=fences
        if world is None
        else {**fences, **actor_fences(files.campaign, part.actors, world.frame, problems)},
        fences_on_earth=_fences_on_earth(part),
        guarding=_guard_setup(part),
        oracles=uses,
        faults=fault_setups(files.campaign, part.faults, vehicles, problems),
        preflight=part.preflight,
        record=part.record,
        observers=observer_setups(files.campaign, part, problems),
        limits=None if part.limits is None else part.limits.limits(),
        gcs=_gcs(part.operator.gcs),
        speed=None if part.clock is None else part.clock.speed,
        collision_always=part.collision_always == "on",
        firmware=part.wanted_firmware,
        permits={
            f"operator.{name}.{by}": text
            for name, channel in part.operator.channels.items()
            for by, text in channel.permits.items()
        },
    )
    if part.geofence is None or fences:
        # With a faulty fence left out, every check would report that the fence is missing.
        check_across = worldless_problems if world is None else cross_problems
        problems += check_across(files, setup, modes)
    if world is None:
        raise BadInput(problems, document_warnings(files))
    if problems:
        raise BadInput(problems, case_warnings(files, setup, modes))
    return setup


def load_models() -> None:
    """Load what `read_setup` uses of plugins, and build its models' validators; 0.1 s of CPU.

    The run server calls it before it forks, so that runs do not. Raises BadInput for a plugin that
    cannot be used.
    """
    models: list[type[BaseModel]] = [campaign_model(), WorldModel, RecipePart, Profile, SyncSetup]
    models += [kind.parameters for kind in oracle_kinds().values()]
    models += [step.parameters for step in registered_steps()]
    for model in models:
        model.model_rebuild()
    for autopilot in autopilot_strategies():
        known_parameters(autopilot)


def collect_problems(problems: list[Problem], read: Callable[[], T]) -> T | None:
    """Return the result of a reader function; on BadInput collect its problems and return None."""
    try:
        return read()
    except BadInput as error:
        problems += error.problems
        return None


def _read_case(
    read: Callable[[Document], T], document: Document | None, problems: list[Problem]
) -> T | None:
    return None if document is None else collect_problems(problems, partial(read, document))


def _gcs(part: GcsPart) -> dict[str, str]:
    """Return the ground station links of a case by vehicle."""
    given: dict[VehicleName, str | None] = {"real": part.real, "twin": part.twin}
    return {name: link for name, link in given.items() if link is not None}


def _fences(
    files: CaseFiles, part: CampaignPart, world: World | None, problems: list[Problem]
) -> Mapping[str, Fence]:
    """Return the fences of a case by vehicle; problems are collected. world: None where missing."""
    if part.geofence is None:
        return {}
    drawing = FenceDrawing(files.campaign, files.fences, None if world is None else world.frame)
    return (
        collect_problems(
            problems, partial(fences_of_vehicles, part.geofence, drawing, ("geofence",))
        )
        or {}
    )


def _fences_on_earth(part: CampaignPart) -> frozenset[str]:
    """Return the vehicles and actors of a case whose fence is given in degrees."""
    given = {} if part.geofence is None else part.geofence.of_vehicles
    actors = {name: one.geofence for name, one in part.actors.items() if one.geofence is not None}
    return frozenset(name for name, one in {**given, **actors}.items() if one.is_on_earth)


def _guard_setup(part: CampaignPart) -> GuardingSetup:
    """Return the guard's distances and latencies of a case, from its `geofence`."""
    given = part.geofence
    if given is None:
        return GuardingSetup()
    return GuardingSetup(
        keep_m=given.keep_m, latency_s=given.latency_s, braking_m_s2=given.braking_m_s2
    )


def _goal(part: GoalPart) -> GoalSetup:
    """Return the goal of a case as the run needs it: altitude, gates, position in NED."""
    place = part.position
    return GoalSetup(
        altitude_m=part.altitude_m,
        gates=tuple(part.gates),
        position_ned_m=None if place is None else (place.north_m, place.east_m, -place.up_m),
    )


def _sync(campaign: CampaignPart, uses: tuple[OracleUse, ...]) -> SyncSetup:
    """Return the time-outs and limits of a pair; the goal time-out covers its time limits."""
    part, twin = campaign.sync, campaign.vehicles.twin
    limits = [use.parameters for use in uses if isinstance(use.parameters, TimeLimitParameters)]
    longest_s = max([_GOAL_S, *(limit.limit_s + _GRACE_S for limit in limits)])
    coupling = "follow" if twin is None else twin.coupling
    found = {
        "goal_timeout_s": part.goal_timeout_s or longest_s,
        "max_twin_distance_m": part.max_twin_distance_m or LIMITS_M[coupling],
    }
    return SyncSetup(**(dict(part) | found))


def _under_test(files: CaseFiles, part: CampaignPart) -> UnderTest:
    """Return a case's autonomy with its goal: altitude, place, number of gates; no geometry."""
    goal: dict[str, float | str] = {"altitude_m": part.goal.altitude_m}
    if part.goal.gates:
        goal["gate_count"] = len(part.goal.gates)
    if part.goal.position is not None:
        place = part.goal.position
        goal |= {"north_m": place.north_m, "east_m": place.east_m, "up_m": place.up_m}
    return UnderTest(
        use=part.autonomy.use,
        folder=Path(files.folder).resolve(),
        rate_hz=part.autonomy.rate_hz,
        parameters=dict(part.autonomy.with_),
        goal=goal,
        foreign=_foreign_autonomy(part.autonomy),
        limits=part.autonomy.limits.limits(),
    )


def _foreign_autonomy(part: AutonomyPart) -> ForeignAutonomy | None:
    """Return a case's autonomy of a plugin's kind; None for a class."""
    for name in part.foreign:
        found: ForeignAutonomy = load_plugin_object(plugin_additions(autonomy_kinds)[name].setup)(
            getattr(part, name)
        )
        return found
    return None


def unique_problems(problems: list[Problem]) -> tuple[Problem, ...]:
    """Return the problems of a case once each, by file and in the order of lines."""
    files = list(dict.fromkeys(problem.file for problem in problems))
    ordered = sorted(dict.fromkeys(problems), key=lambda p: (files.index(p.file), p.line, p.column))
    return tuple(problem for problem, _ in itertools.groupby(ordered))


def observer_setups(
    file: Document, part: CampaignPart, problems: list[Problem]
) -> dict[str, ObserverSetup]:
    """Return the observers' setups of a case by their keys; problems are collected."""
    found: dict[str, ObserverSetup] = {}
    for name, observer in plugin_additions(run_observers).items():
        setup = load_plugin_object(observer.setup)(getattr(part, name), file, part, problems)
        if setup is not None:
            found[name] = setup
    return found
