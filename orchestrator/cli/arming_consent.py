"""Checks and consent before a campaign arms attached vehicles, which may be hardware."""

import asyncio
import contextlib
import os
import pwd
import sys
import termios
from collections.abc import Collection, Iterable, Iterator
from importlib.util import find_spec

from wil_campaign.campaigns.expansion.expansion import Campaign
from wil_campaign.campaigns.setup.actor_setups import ActorSetup
from wil_campaign.campaigns.setup.bench_file import Bench
from wil_campaign.campaigns.setup.encounters import actor_encounters
from wil_campaign.campaigns.setup.vehicle_setups import FlownSetup
from wil_campaign.foundation.clocks.virtual_loop import Clock
from wil_campaign.foundation.files.paths import path_exists
from wil_campaign.foundation.processes.linux import usable_cores
from wil_campaign.orchestrator.campaign.flight_options import ClearedCampaign, FlightOptions
from wil_campaign.orchestrator.campaign.resuming.attached_vehicles import (
    AttachedVehicle,
    attached_vehicles,
    find_attached_vehicles,
    find_vehicle_at,
    flown_vehicles,
    kinds_of_real,
    planned_setups,
    vehicles_with_open_poses,
)
from wil_campaign.orchestrator.campaign.workers.run_engine import LOCAL
from wil_campaign.orchestrator.cli.clock_choice import campaign_clock_for, shared_resources_of
from wil_campaign.orchestrator.cli.standard_streams import write_stderr
from wil_campaign.orchestrator.cli.text_table import count_text
from wil_campaign.orchestrator.run_results.campaign_results import VehicleKind
from wil_campaign.orchestrator.state.parameter_backups import NoHomeError, parameter_backup_folder
from wil_campaign.orchestrator.state.run_setup import place_of_vehicle
from wil_campaign.vehicles.errors import NO_JSBSIM, VehicleError
from wil_campaign.vehicles.links.link_strings import LinkAddress

REFUSED = 2
UNAVAILABLE = 3
_IDENTIFY_S = 5.0


class FlightRefusedError(Exception):
    """A campaign that may not be flown or armed; with the exit code and the remedy."""

    def __init__(self, text: str, code: int) -> None:
        super().__init__(text)
        self.code = code


class NotConfirmedError(FlightRefusedError):
    """The person at the terminal did not consent."""


def clear_for_flight(campaign: Campaign, options: FlightOptions) -> ClearedCampaign:
    """Settle clock and jobs, identify attached vehicles, and get the consent to arm."""
    if options.engine == LOCAL and find_spec("jsbsim") is None:
        _require_no_embedded(campaign)
    jobs = options.jobs
    attached = attached_vehicles(campaign)
    wanted = settled_clock(campaign, options.clock)
    shared = shared_resources_of(campaign)
    if jobs is not None and jobs < 1:
        raise FlightRefusedError(f"--jobs {jobs}: must be at least 1", REFUSED)
    if shared and (jobs or 1) > 1:
        raise FlightRefusedError(
            f"--jobs {jobs}: runs of this campaign would share {shared[0]}", REFUSED
        )
    if not attached:
        most = 1 if shared else _default_jobs(wanted)
        return ClearedCampaign(wanted, jobs or most, _kind_of_real(campaign, ()))
    where = " and ".join(f"{flown.name} ({flown.attached})" for flown in attached)
    if jobs is not None and jobs > 1:
        raise FlightRefusedError(f"--jobs {jobs}: {where} can fly one run at a time only", REFUSED)
    if options.arm:
        _require_options(attached, options)
        require_may_arm(campaign.benches, user_name())
        _require_backups()
    found = find_vehicles_to_arm(attached)
    real_kind = _kind_of_real(campaign, found)
    if options.arm:
        _confirm(campaign, found)
    hardware = " and ".join(vehicle.name for vehicle in found if not vehicle.identity.simulation)
    places = map(place_of_vehicle, attached)
    uids = dict(zip(places, (vehicle.identity.uid for vehicle in found), strict=True))
    settings = _settings_of(campaign, found)
    return ClearedCampaign(wanted, 1, real_kind, hardware, settings=settings, uids=uids)


def _settings_of(campaign: Campaign, found: Iterable[AttachedVehicle]) -> tuple[str, ...]:
    """Return the settings by which simulations are judged by the ground truth that they offer."""
    asked = [vehicle for vehicle in found if vehicle.name in vehicles_with_open_poses(campaign)]
    for vehicle in asked:
        write_stderr(vehicle.judged_text)
    settings = (
        f"vehicles.{vehicle.name}.pose_source=simulator" for vehicle in asked if vehicle.truth
    )
    return tuple(dict.fromkeys(settings))


def _require_no_embedded(campaign: Campaign) -> None:
    """Raise RefusedError for vehicles that only JSBSim can simulate."""
    if names := [
        flown_vehicle.name
        for flown_vehicle in flown_vehicles(campaign)
        if flown_vehicle.embedded and flown_vehicle.physics == "jsbsim"
    ]:
        raise FlightRefusedError(f"{' and '.join(names)}: {NO_JSBSIM}", REFUSED)


def _kind_of_real(campaign: Campaign, found: Iterable[AttachedVehicle]) -> VehicleKind:
    """Return what flies as the real vehicle in all runs. Raises RefusedError for several kinds."""
    cases = kinds_of_real(campaign, found)
    if len(cases) > 1:
        where = " and ".join(f"{kind} in {', '.join(names)}" for kind, names in cases.items())
        raise FlightRefusedError(
            f"real is {where}: the results of a campaign state one kind of real vehicle; fly these "
            "cases as campaigns of their own, by --case",
            REFUSED,
        )
    return next(iter(cases), "embedded")


def _require_options(attached: Iterable[FlownSetup], options: FlightOptions) -> None:
    """Raise RefusedError for attached vehicles that the command line does not allow to arm."""
    given = {"--arm-real": options.arm_real, "--arm-actors": options.arm_actors}
    by_option: dict[str, list[FlownSetup]] = {}
    for flown in attached:
        option = "--arm-actors" if isinstance(flown, ActorSetup) else "--arm-real"
        by_option.setdefault(option, []).append(flown)
    for option, vehicles in by_option.items():
        if not given[option]:
            where = " and ".join(f"{vehicle.name} ({vehicle.attached})" for vehicle in vehicles)
            raise FlightRefusedError(
                f"{where}: it may be hardware, and is armed only with {option}; --no-arm checks "
                "everything else",
                REFUSED,
            )


def require_may_arm(benches: Iterable[Bench], user: str) -> None:
    """Raise RefusedError where a bench does not let this user consent to arm."""
    for bench in benches:
        if bench.users is not None and not bench.may_arm(user):
            raise FlightRefusedError(
                f"bench {bench.name}: {user} may not arm there, only {', '.join(bench.users)} "
                f"({bench.document.name}, arming.users); --no-arm checks everything else",
                REFUSED,
            )


def _require_backups() -> None:
    """Raise RefusedError where parameters of attached vehicles cannot be backed up."""
    try:
        folder = parameter_backup_folder()
    except NoHomeError as error:
        raise FlightRefusedError(str(error), REFUSED) from error
    there = next(path for path in (folder, *folder.parents) if path_exists(path))
    if not os.access(there, os.W_OK | os.X_OK):
        raise FlightRefusedError(
            f"parameters of attached vehicles cannot be backed up in {folder}: {there} is not "
            "writable; set XDG_STATE_HOME to a folder that outlives a reboot",
            REFUSED,
        )


def user_name() -> str:
    """Return the name of the user of this process; the user id where it has no name."""
    try:
        return pwd.getpwuid(os.getuid()).pw_name
    except KeyError:
        return str(os.getuid())


def _default_jobs(clock: Clock) -> int:
    """Return the default number of parallel runs for a clock."""
    cores = usable_cores()
    return cores if clock == "virtual" else max(1, cores // 2)


def settled_clock(campaign: Campaign, requested: Clock | None) -> Clock:
    """Return the clock of a campaign to be armed. Raises RefusedError, BadInput."""
    able = campaign_clock_for(campaign, requested)
    outside = [
        flown_vehicle.name
        for flown_vehicle in flown_vehicles(campaign)
        if not flown_vehicle.embedded
    ]
    if requested == "virtual" and outside:
        raise FlightRefusedError(
            f"--clock virtual: {' and '.join(outside)} is not embedded and flies in real time; "
            "leave --clock out, or use --clock wall",
            REFUSED,
        )
    return requested or ("wall" if outside and able == "virtual" else able)


def clear_vehicle(address: LinkAddress, *, purpose: str, arm_real: bool) -> AttachedVehicle:
    """Identify the simulator at an address, and get the consent to arm it. Raises RefusedError.

    purpose: what it is armed for. A vehicle that does not report to be a simulation is refused.
    """
    if not arm_real:
        raise FlightRefusedError(
            f"{address}: it may be hardware, and is armed only with --arm-real; without --fly it "
            "is only identified",
            REFUSED,
        )
    found = find_vehicle_to_arm(address)
    write_stderr(found)
    if not found.identity.simulation:
        raise FlightRefusedError(
            f"{found.name} reports a board ({found.identity.uid}), not a simulation: {purpose} is "
            "for simulators only; start the firmware as SITL and give its link",
            REFUSED,
        )
    _refuse_armed(found)
    if has_terminal():
        _ask_person(f"{purpose}. Arm {found.name} ({found.where}) and take off? [y/N] ")
    return found


def find_vehicle_to_arm(address: LinkAddress) -> AttachedVehicle:
    """Return the vehicle at an address, identified. Raises RefusedError."""
    try:
        return asyncio.run(find_vehicle_at(address, _IDENTIFY_S))
    except VehicleError as error:
        raise FlightRefusedError(str(error), UNAVAILABLE) from error


def find_vehicles_to_arm(vehicles: Iterable[FlownSetup]) -> tuple[AttachedVehicle, ...]:
    """Return the attached vehicles to be armed, identified. Raises RefusedError."""
    try:
        found = asyncio.run(find_attached_vehicles(vehicles, _IDENTIFY_S))
    except VehicleError as error:
        raise FlightRefusedError(str(error), UNAVAILABLE) from error
    for vehicle in found:
        write_stderr(vehicle)
        _refuse_armed(vehicle)
    return found


def _refuse_armed(vehicle: AttachedVehicle) -> None:
    """Refuse a vehicle that is armed. Raises RefusedError."""
    if vehicle.armed:
        raise FlightRefusedError(
            f"{vehicle.name} is armed already; disarm it and start again", UNAVAILABLE
        )


def _confirm(campaign: Campaign, found: tuple[AttachedVehicle, ...]) -> None:
    """Ask the person at the terminal, if there is one, for consent to encounters and to arming.

    Raises RefusedError without consent, and without a terminal when boards could touch.
    """
    for actor, other in _encounters(campaign, found):
        encounter = f"{actor.name} flies beside {other.name}, and their fences let them touch"
        if has_terminal():
            _require_answer(f"{encounter}. Type {actor.name} to consent: ", {actor.name.lower()})
        elif not (actor.identity.simulation and other.identity.simulation):
            raise FlightRefusedError(
                f"{encounter}: one of them may be hardware; consent is given by a person at a "
                "terminal",
                REFUSED,
            )
    if has_terminal():
        ask_to_arm(f"campaign '{campaign.name}'", len(campaign.plans), found)


def _encounters(
    campaign: Campaign, found: Iterable[AttachedVehicle]
) -> Iterator[tuple[AttachedVehicle, AttachedVehicle]]:
    """Yield each pair of an actor and another attached vehicle that could touch, once."""
    by_name = {vehicle.name: vehicle for vehicle in found}
    names = dict.fromkeys(
        (encounter.actor.name, encounter.other.name)
        for setup, mode in planned_setups(campaign)
        for encounter in actor_encounters(setup, mode)
        if not encounter.is_far
    )
    return ((by_name[actor], by_name[other]) for actor, other in names)


def has_terminal() -> bool:
    """Return whether a person can be asked."""
    return sys.stdin.isatty() and sys.stderr.isatty()


def ask_to_arm(what: str, count: int, found: tuple[AttachedVehicle, ...]) -> None:
    """Ask the person at the terminal for consent to arm vehicles. Raises RefusedError without."""
    names = " and ".join(f"{vehicle.name} ({vehicle.where})" for vehicle in found)
    _ask_person(f"{what}, {count_text(count, 'run')}. Arm {names} and take off? [y/N] ")


def _ask_person(question: str) -> None:
    """Ask the person at the terminal. Raises RefusedError without a yes."""
    _require_answer(question, {"y", "yes"})


def _require_answer(question: str, answers: Collection[str]) -> None:
    """Ask the person at the terminal. Raises RefusedError for any other answer.

    What was typed before the question answers nothing: a search asks again after each flight.
    """
    with contextlib.suppress(OSError, termios.error):  # no terminal, or one that hung up
        termios.tcflush(sys.stdin, termios.TCIFLUSH)
    sys.stderr.write(question)
    sys.stderr.flush()
    if sys.stdin.readline().strip().lower() not in answers:
        raise NotConfirmedError("not confirmed; nothing was armed", REFUSED)
