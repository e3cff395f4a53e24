"""Checks and consent before a campaign arms attached vehicles, which may be hardware."""

import asyncio
import os
import pwd
import sys
import termios
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass

from campaigns.expansion.expansion import Campaign
from campaigns.setup.actor_setups import ActorSetup
from campaigns.setup.bench_file import Bench
from campaigns.setup.encounters import encounters
from campaigns.setup.vehicle_setups import FlownSetup
from orchestrator.campaign.resuming.attached_vehicles import (
    AttachedVehicle,
    attached_vehicles,
    find_all,
    find_at,
    flown_vehicles,
    kinds_of_real,
    planned_setups,
)
from orchestrator.cli.clock_choice import clock_for, shared_of
from orchestrator.cli.standard_streams import err
from orchestrator.cli.text_table import count_text
from orchestrator.engines.node_messages import ConsentAnswer, ConsentAsked
from orchestrator.model.campaign_results import VehicleKind
from orchestrator.model.clock import Clock
from vehicles.errors import VehicleError
from vehicles.links.link_strings import LinkAddress
from vehicles.processes.linux import usable_cores
from worlds.files.problems import printable

REFUSED = 2
UNAVAILABLE = 3
_IDENTIFY_S = 5.0


class RefusedError(Exception):
    """A campaign that may not be flown or armed; with the exit code and the remedy."""

    def __init__(self, text: str, code: int) -> None:
        super().__init__(text)
        self.code = code


@dataclass(frozen=True, slots=True)
class Cleared:
    """A campaign cleared for arming. real_kind: what flies as the real vehicle.

    hardware: the names of the vehicles that are not simulations; empty for none.
    """

    clock: Clock
    jobs: int
    real_kind: VehicleKind
    hardware: str = ""


def clear(
    campaign: Campaign,
    *,
    clock: Clock | None,
    jobs: int | None,
    arm: bool,
    arm_real: bool,
    arm_actors: bool = False,
) -> Cleared:
    """Settle clock and jobs, identify attached vehicles, and get the consent to arm.

    arm: whether anything is armed at all. arm_real: whether attached vehicles of the pair may be,
    arm_actors: whether attached actors may be.
    """
    attached = attached_vehicles(campaign)
    wanted = settled_clock(campaign, clock)
    shared = shared_of(campaign)
    if jobs is not None and jobs < 1:
        raise RefusedError(f"--jobs {jobs}: must be at least 1", REFUSED)
    if shared and (jobs or 1) > 1:
        raise RefusedError(f"--jobs {jobs}: runs of this campaign would share {shared[0]}", REFUSED)
    if not attached:
        most = 1 if shared else _default_jobs(wanted)
        return Cleared(wanted, jobs or most, _kind_of_real(campaign, ()))
    where = " and ".join(f"{one.name} ({one.attached})" for one in attached)
    if jobs is not None and jobs > 1:
        raise RefusedError(f"--jobs {jobs}: {where} can fly one run at a time only", REFUSED)
    if arm:
        _require_options(attached, arm_real=arm_real, arm_actors=arm_actors)
        require_may_arm(campaign.benches, user_name())
    found = _find_vehicles(attached)
    real_kind = _kind_of_real(campaign, found)
    if arm:
        _confirm(campaign, found)
    hardware = " and ".join(one.name for one in found if not one.identity.simulation)
    return Cleared(wanted, 1, real_kind, hardware)


def _kind_of_real(campaign: Campaign, found: Iterable[AttachedVehicle]) -> VehicleKind:
    """Return what flies as the real vehicle in all runs. Raises RefusedError for several kinds."""
    cases = kinds_of_real(campaign, found)
    if len(cases) > 1:
        where = " and ".join(f"{kind} in {', '.join(names)}" for kind, names in cases.items())
        raise RefusedError(
            f"real is {where}: the results of a campaign state one kind of real vehicle; fly these "
            "cases as campaigns of their own, by --case",
            REFUSED,
        )
    return next(iter(cases), "embedded")


def _require_options(attached: Iterable[FlownSetup], *, arm_real: bool, arm_actors: bool) -> None:
    """Raise RefusedError for attached vehicles that the command line does not allow to arm."""
    given = {"--arm-real": arm_real, "--arm-actors": arm_actors}
    by_option: dict[str, list[FlownSetup]] = {}
    for one in attached:
        option = "--arm-actors" if isinstance(one, ActorSetup) else "--arm-real"
        by_option.setdefault(option, []).append(one)
    for option, vehicles in by_option.items():
        if not given[option]:
            where = " and ".join(f"{one.name} ({one.attached})" for one in vehicles)
            raise RefusedError(
                f"{where}: it may be hardware, and is armed only with {option}; --no-arm checks "
                "everything else",
                REFUSED,
            )


def require_may_arm(benches: Iterable[Bench], user: str) -> None:
    """Raise RefusedError where a bench does not let this user consent to arm."""
    for bench in benches:
        if bench.users is not None and not bench.may_arm(user):
            raise RefusedError(
                f"bench {bench.name}: {user} may not arm there, only {', '.join(bench.users)} "
                f"({bench.document.name}, arming.users); --no-arm checks everything else",
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
    able = clock_for(campaign, requested)
    outside = [one.name for one in flown_vehicles(campaign) if not one.embedded]
    if requested == "virtual" and outside:
        raise RefusedError(
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
        raise RefusedError(
            f"{address}: it may be hardware, and is armed only with --arm-real; without --fly it "
            "is only identified",
            REFUSED,
        )
    found = find_vehicle(address)
    err(found)
    if not found.identity.simulation:
        raise RefusedError(
            f"{found.name} reports a board ({found.identity.uid}), not a simulation: {purpose} is "
            "for simulators only; start the firmware as SITL and give its link",
            REFUSED,
        )
    _refuse_armed(found)
    if has_terminal():
        _ask_person(f"{purpose}. Arm {found.name} ({found.where}) and take off? [y/N] ")
    return found


def find_vehicle(address: LinkAddress) -> AttachedVehicle:
    """Return the vehicle at an address, identified. Raises RefusedError."""
    try:
        return asyncio.run(find_at(address, _IDENTIFY_S))
    except VehicleError as error:
        raise RefusedError(str(error), UNAVAILABLE) from error


def _find_vehicles(vehicles: Iterable[FlownSetup]) -> tuple[AttachedVehicle, ...]:
    """Return the attached vehicles to be armed, identified. Raises RefusedError."""
    try:
        found = asyncio.run(find_all(vehicles, _IDENTIFY_S))
    except VehicleError as error:
        raise RefusedError(str(error), UNAVAILABLE) from error
    for one in found:
        err(one)
        _refuse_armed(one)
    return found


def _refuse_armed(vehicle: AttachedVehicle) -> None:
    """Refuse a vehicle that is armed. Raises RefusedError."""
    if vehicle.armed:
        raise RefusedError(
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
            raise RefusedError(
                f"{encounter}: one of them may be hardware; consent is given by a person at a "
                "terminal",
                REFUSED,
            )
    if has_terminal():
        _ask_to_arm(f"campaign '{campaign.name}'", len(campaign.plans), found)


def _encounters(
    campaign: Campaign, found: Iterable[AttachedVehicle]
) -> Iterator[tuple[AttachedVehicle, AttachedVehicle]]:
    """Yield each pair of an actor and another attached vehicle that could touch, once."""
    by_name = {one.name: one for one in found}
    names = dict.fromkeys(
        (one.actor.name, one.other.name)
        for setup, mode in planned_setups(campaign)
        for one in encounters(setup, mode)
        if not one.is_far
    )
    return ((by_name[actor], by_name[other]) for actor, other in names)


def has_terminal() -> bool:
    """Return whether a person can be asked."""
    return sys.stdin.isatty() and sys.stderr.isatty()


def _ask_to_arm(what: str, count: int, found: tuple[AttachedVehicle, ...]) -> None:
    """Ask the person at the terminal for consent to arm vehicles. Raises RefusedError without."""
    names = " and ".join(f"{one.name} ({one.where})" for one in found)
    _ask_person(f"{what}, {count_text(count, 'run')}. Arm {names} and take off? [y/N] ")


def _ask_person(question: str) -> None:
    """Ask the person at the terminal. Raises RefusedError without a yes."""
    _require_answer(question, {"y", "yes"})


def _require_answer(question: str, answers: Collection[str]) -> None:
    """Ask the person at the terminal. Raises RefusedError for any other answer."""
    sys.stderr.write(question)
    sys.stderr.flush()
    if sys.stdin.readline().strip().lower() not in answers:
        raise RefusedError("not confirmed; nothing was armed", REFUSED)


def consent_at_bench(bench: Bench, request: ConsentAsked) -> ConsentAnswer:
    """Return this bench's answer to a campaign of the cluster, given by the person at its terminal.

    The vehicle is identified first. Input that was typed before the question is discarded.
    """
    what = printable(f"campaign '{request.campaign}' of {request.place}")
    try:
        if request.arm:
            require_may_arm((bench,), user_name())
        found = _find_vehicles((bench.vehicle,))
        if request.arm:
            termios.tcflush(sys.stdin, termios.TCIFLUSH)
            _ask_to_arm(what, request.runs, found)
    except RefusedError as error:
        err(f"{what}: {error}")
        return ConsentAnswer(f"bench {bench.name}: {error}", error.code)
    is_hardware = not all(one.identity.simulation for one in found)
    return ConsentAnswer(
        code=0,
        real_kind="hardware" if is_hardware else "sitl",
        hardware=bench.vehicle.name if is_hardware else "",
        vehicle=" and ".join(map(str, found)),
    )
