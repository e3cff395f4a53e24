"""Who flies the vehicles of a run: the campaign's autonomy, in this process or a program."""

from collections.abc import AsyncIterator, Mapping
from contextlib import AsyncExitStack, asynccontextmanager

from orchestrator.outside.program import ProgramPilot
from orchestrator.run.answers import LONGEST_CONSTRUCTION_S, AutonomyFault, asked
from orchestrator.run.control import Pilot
from orchestrator.run.course import Course
from orchestrator.run.opening import Pair
from orchestrator.run.setup import RunSetup
from orchestrator.run.station import Station
from vehicles.autonomy import Autonomy
from vehicles.autopilots.base import Target

AnyPilot = Pilot | ProgramPilot


@asynccontextmanager
async def open_pilots(
    setup: RunSetup, pair: Pair, course: Course
) -> AsyncIterator[Mapping[str, AnyPilot]]:
    """Build the pilots by vehicle; programs run while this is open.

    Raises AutonomyFault for an autonomy that cannot be built, VehicleError for a program that
    cannot be started.
    """
    pilots: dict[str, AnyPilot] = {}
    async with AsyncExitStack() as stack:
        for station in pair.stations:
            if setup.campaign.under_test.program is None:
                pilots[station.name] = Pilot(
                    autonomy=_built(setup, station.name),
                    station=station,
                    course=course,
                    rate_hz=setup.campaign.under_test.rate_hz,
                )
            else:
                program = _program(setup, pair, station, course)
                pilots[station.name] = await stack.enter_async_context(program)
        yield pilots


def _built(setup: RunSetup, name: str) -> Autonomy:
    """Return the autonomy of a vehicle. Raises AutonomyFault."""
    try:
        return asked(
            lambda: setup.campaign.under_test.build(setup.seed), within_s=LONGEST_CONSTRUCTION_S
        )
    except AutonomyFault as fault:
        raise AutonomyFault(f"the autonomy of {name} {fault}", fault.trace) from None


def _program(setup: RunSetup, pair: Pair, station: Station, course: Course) -> ProgramPilot:
    # What is perceived in mode wil is as large as the real picture, which it replaces.
    owner = setup.vehicle("real" if setup.mode == "wil" else station.name)
    return ProgramPilot(
        under_test=setup.campaign.under_test,
        station=station,
        link=pair.links[station.name],
        target=Target(setup.vehicle(station.name).system_id),
        camera=next(iter(owner.cameras), None),
        course=course,
        folder=setup.order.folder,
        seed=setup.seed,
    )
