"""What is put aboard the vehicles before they arm, and taken back when they have landed.

Parameters of the campaign, and a fence of the autopilot's own: the second line behind the guard's.
"""

import asyncio
from collections.abc import Callable, Mapping
from contextlib import AsyncExitStack

from campaigns.setup import VehicleSetup
from orchestrator.run.course import Course
from orchestrator.run.fences_aboard import FencesAboard
from orchestrator.run.journals import journal_folder
from orchestrator.run.preflight import ceiling_above_home_m, sets_failsafes, wanted_failsafes
from orchestrator.run.setup import RunSetup
from orchestrator.run.station import Station
from orchestrator.run.written_logs import flight_log
from vehicles.driver.fence_notes import restore_fence
from vehicles.driver.parameter_context import ParameterValue
from vehicles.errors import VehicleError

Note = Callable[..., None]

_LOG_S = 300.0
"""How long a log may take: at 57.6 kbit/s a megabyte."""


class Aboard:
    """Puts aboard, takes back, and fetches logs, for all vehicles of a run.

    note: takes what is worth recording. Only of attached vehicles anything is taken back: the
    others end with the run.
    """

    def __init__(
        self, *, setup: RunSetup, stations: tuple[Station, ...], course: Course, note: Note
    ) -> None:
        self._setup = setup
        self._stations = stations
        self._course = course
        self._note = note
        self._stacks: dict[str, AsyncExitStack] = {}
        self._unbooted: dict[str, frozenset[str]] = {}
        self.fences = FencesAboard(setup=setup, stations=stations, note=note)

    @property
    def unbooted(self) -> Mapping[str, frozenset[str]]:
        """Return by vehicle the parameters that were changed while it ran: some wait for a boot."""
        return self._unbooted

    async def put(self, station: Station) -> None:
        """Set a ready vehicle's parameters and fence, each read back. Raises VehicleError."""
        vehicle = self._setup.vehicle(station.name)
        stack = self._stacks[station.name] = AsyncExitStack()
        await self._put_parameters(station, vehicle, stack)
        await self.fences.put(station, stack)

    async def take_back(self) -> None:
        """Set everything back as it was; what cannot be is decisive, for it stays so."""
        await asyncio.gather(*(self._undo(name, one) for name, one in self._stacks.items()))
        self._stacks.clear()

    async def fetch_logs(self) -> None:
        """Fetch each vehicle's newest log into the run's folder; what fails is noted."""
        if self._setup.campaign.record.vehicle_logs:
            await asyncio.gather(*map(self._fetch_log, self._stations))

    async def _put_parameters(
        self, station: Station, vehicle: VehicleSetup, stack: AsyncExitStack
    ) -> None:
        parameters = station.driver.parameters
        if vehicle.attached is None:
            # All were born with the campaign's, and end with the run; a simulator has to show that
            # it was.
            given = {} if vehicle.embedded else vehicle.params
            for name, value in {**await self._failsafes(station, vehicle), **given}.items():
                await parameters.set(name, value)
            return
        journal = journal_folder()
        restored = await parameters.restore_leftovers(journal)
        for change in restored.restored:
            self._note("parameter", vehicle=station.name, name=change.name, value=change.before)
        fences = station.driver.onboard.fences
        if await restore_fence(journal, fences=fences, vehicle=parameters.vehicle):
            self._note("fence_given_back", vehicle=station.name)
        changes = {**await self._failsafes(station, vehicle), **vehicle.params}
        changed = parameters.changed(changes, journal=journal)
        await stack.enter_async_context(changed)
        moved = (*restored.restored, *(one for one in changed.changes if one.before != one.wanted))
        self._unbooted[station.name] = frozenset(one.name for one in moved)

    async def _failsafes(
        self, station: Station, vehicle: VehicleSetup
    ) -> Mapping[str, ParameterValue]:
        """Return what the autopilot's own failsafes are set to; the campaign's `params` are left.

        By default what is attached is not touched; its failsafes are looked at by the preflight.
        """
        if not sets_failsafes(self._setup, vehicle):
            return {}
        ceiling_m = ceiling_above_home_m(self._setup, vehicle)
        wanted = await wanted_failsafes(
            station.driver.identity.autopilot, station.driver.parameters, ceiling_m=ceiling_m
        )
        return {name: value for name, value in wanted.items() if name not in vehicle.params}

    async def _undo(self, name: str, stack: AsyncExitStack) -> None:
        try:
            await stack.aclose()
        except VehicleError as error:
            self._course.decide("ERROR", f"{name} keeps what was put aboard: {error}")

    async def _fetch_log(self, station: Station) -> None:
        logs, folder = station.driver.onboard.logs, self._setup.order.folder
        # What we launched writes them here; PX4's take longer over MAVLink than the flight did.
        written = flight_log(folder / f"{station.name}-sitl")
        if written is not None:
            self._note("log", vehicle=station.name, text=str(written.relative_to(folder)))
            return
        try:
            async with asyncio.timeout(_LOG_S):
                entries = await logs.list()
                if not entries:
                    self._note("log", vehicle=station.name, text="it has no log")
                    return
                file = await logs.fetch(entries[-1], folder, name=station.name)
        except TimeoutError:
            self._note("log", vehicle=station.name, text=f"not fetched within {_LOG_S:g} s")
        except VehicleError as error:
            self._note("log", vehicle=station.name, text=str(error))
        else:
            self._note("log", vehicle=station.name, text=file.name)
