"""What is put aboard the vehicles before they arm, and taken back when they have landed.

Parameters of the campaign, and a fence of the autopilot's own: the second line behind the guard's.
"""

import asyncio
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import AsyncExitStack
from pathlib import Path

import shapely

from campaigns.setup import VehicleSetup
from orchestrator.run.course import Course
from orchestrator.run.preflight import ceiling_above_home_m, wanted_failsafes
from orchestrator.run.setup import RunSetup
from orchestrator.run.station import Station
from safety.areas import Area, Circle, Point2
from safety.geofence import Fence
from vehicles.driver.fence import FenceArea, FenceCircle, FencePolygon, OwnFence, Place
from vehicles.driver.parameter_context import ParameterValue
from vehicles.errors import VehicleError

Note = Callable[..., None]

_LOG_S = 300.0
"""How long a log may take: at 57.6 kbit/s a megabyte."""
_PLACE_S, _LOOK_S = 3.0, 0.05
"""How long is waited for its place on earth: that comes twice a second, on a radio that loses."""
_QUARTER = 6
"""Corners of a circle's quarter where it is joined with other areas: autopilots keep 70 in all."""


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

    @property
    def unbooted(self) -> Mapping[str, frozenset[str]]:
        """Return by vehicle the parameters that were changed while it ran: some wait for a boot."""
        return self._unbooted

    async def put(self, station: Station) -> None:
        """Set a ready vehicle's parameters and fence, each read back. Raises VehicleError."""
        vehicle = self._setup.vehicle(station.name)
        stack = self._stacks[station.name] = AsyncExitStack()
        await self._put_parameters(station, vehicle, stack)
        await self._put_fence(station, vehicle, stack)

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
        how = self._setup.campaign.preflight.failsafe
        if how == "check" or (how is None and vehicle.attached is not None):
            return {}
        ceiling_m = ceiling_above_home_m(self._setup, vehicle)
        wanted = await wanted_failsafes(
            station.driver.identity.autopilot, station.driver.parameters, ceiling_m=ceiling_m
        )
        return {name: value for name, value in wanted.items() if name not in vehicle.params}

    async def _put_fence(
        self, station: Station, vehicle: VehicleSetup, stack: AsyncExitStack
    ) -> None:
        fence = self._setup.campaign.fences.get(vehicle.name)
        preflight = self._setup.campaign.preflight
        if fence is None or preflight.fence is None:
            return
        for _ in range(round(_PLACE_S / _LOOK_S)):
            if station.driver.place_deg is not None:
                break
            await asyncio.sleep(_LOOK_S)
        own = own_fence(fence, station, margin_m=preflight.fence.margin_m)
        fences, autopilot = station.driver.onboard.fences, station.driver.identity.autopilot
        if vehicle.attached is not None:
            await stack.enter_async_context(fences.kept(autopilot, own, journal=journal_folder()))
        else:
            await fences.keep(autopilot, own)
        self._note("fence", vehicle=station.name, areas=len(own.areas), ceiling_m=own.ceiling_m)

    async def _undo(self, name: str, stack: AsyncExitStack) -> None:
        try:
            await stack.aclose()
        except VehicleError as error:
            self._course.decide("ERROR", f"{name} keeps what was put aboard: {error}")

    async def _fetch_log(self, station: Station) -> None:
        logs, folder = station.driver.onboard.logs, self._setup.order.folder
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


def journal_folder() -> Path:
    """Return where journals of changed parameters outlive this program, and the machine's sleep."""
    state = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return Path(state) / "wil-campaign" / "parameters"


def own_fence(fence: Fence, station: Station, *, margin_m: float) -> OwnFence:
    """Return a campaign's fence for an autopilot to keep, wider by a margin.

    Of inclusions that do not touch, the one that the vehicle stands in is kept: it can fly to no
    other. Raises VehicleError when the vehicle's place on earth is not known.
    """
    areas = [
        *_inclusion(fence.inclusions, station, margin_m),
        *(one for area in fence.exclusions for one in _exclusion(area, station, margin_m)),
    ]
    ceiling_m = None
    if fence.ceiling_up_m is not None:
        ceiling_m = fence.ceiling_up_m + station.start.position_ned_m[2] + margin_m
    return OwnFence(areas=tuple(areas), ceiling_m=ceiling_m, action="land")


def _inclusion(areas: tuple[Area, ...], station: Station, margin_m: float) -> Iterator[FenceArea]:
    if len(areas) == 1 and isinstance(areas[0], Circle):
        yield _disc(areas[0], margin_m, inside=True, station=station)
        return
    grown = shapely.union_all([_shape(area) for area in areas]).buffer(margin_m, join_style="mitre")
    north_m, east_m, _ = station.start.position_ned_m
    for part in getattr(grown, "geoms", (grown,)):
        if part.contains(shapely.Point(north_m, east_m)):
            yield _ring(part.exterior, inside=True, station=station)
            for hole in part.interiors:
                yield _ring(hole, inside=False, station=station)


def _exclusion(area: Area, station: Station, margin_m: float) -> Iterator[FenceArea]:
    if isinstance(area, Circle):
        if area.radius_m > margin_m:
            yield _disc(area, -margin_m, inside=False, station=station)
        return
    left = _shape(area).buffer(-margin_m, join_style="mitre")
    for part in getattr(left, "geoms", (left,)):
        if part.area > 0.0:
            yield _ring(part.exterior, inside=False, station=station)


def _shape(area: Area) -> shapely.Polygon:
    if isinstance(area, Circle):
        return shapely.Point(*area.centre_m).buffer(area.radius_m, quad_segs=_QUARTER)
    return shapely.Polygon(area.corners_m)


def _ring(ring: shapely.LinearRing, *, inside: bool, station: Station) -> FencePolygon:
    corners = [_place((north, east), station) for north, east in list(ring.coords)[:-1]]
    return FencePolygon(tuple(corners), inside=inside)


def _disc(circle: Circle, margin_m: float, *, inside: bool, station: Station) -> FenceCircle:
    return FenceCircle(_place(circle.centre_m, station), circle.radius_m + margin_m, inside=inside)


def _place(point_m: Point2, station: Station) -> Place:
    place = station.driver.place_of((*point_m, 0.0))
    return Place(place.latitude_deg, place.longitude_deg)
