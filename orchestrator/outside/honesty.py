"""Before arming it is proven that each autopilot will act on what the campaign tells it."""

from collections.abc import Iterable, Mapping

from campaigns.outside_setups import Injected, InjectionSetup
from campaigns.setup import VehicleSetup
from orchestrator.run.station import Station
from vehicles.autopilots.base import AutopilotName
from vehicles.autopilots.honest_injection import flown_mode, honoured, parameters_to_ask
from vehicles.autopilots.honoured import Thing
from vehicles.errors import ParameterError, VehicleError
from worlds.frames import Pose, rotate

_DOWN = 0.7
"""A rangefinder that looks down by this share or more measures height, else proximity."""


class NotHonouredError(VehicleError):
    """Something is injected that an autopilot would ignore: which, why, and what to do."""


async def prove(
    stations: Iterable[Station],
    vehicles: Mapping[str, VehicleSetup],
    injections: Iterable[InjectionSetup],
) -> None:
    """Ask each autopilot for the parameters that matter. Raises NotHonouredError with all faults.

    Only what the vehicle itself reports counts: what a campaign has set may not have taken.
    """
    wanted = tuple(injections)
    faults: list[str] = []
    for station in stations:
        vehicle = vehicles[station.name]
        for injection in wanted:
            if station.name in injection.to:
                thing = thing_of(injection.thing, _mount(vehicle, injection.sensor))
                faults += await _faults(station, vehicle.autopilot, thing)
    if faults:
        raise NotHonouredError("injection would be ignored: " + "; ".join(faults))


def thing_of(injected: Injected, mount: Pose | None) -> Thing:
    """Return what an injected thing is to the rules; a rangefinder's mounting tells its use."""
    if injected == "distance_sensor" and mount is not None:
        down = rotate(mount.q_wxyz, (1.0, 0.0, 0.0))[2]
        return "distance_sensor" if down >= _DOWN else "distance_sensor_sideways"
    return injected


async def _faults(station: Station, autopilot: AutopilotName, thing: Thing) -> list[str]:
    parameters: dict[str, float] = {}
    for name in parameters_to_ask(autopilot, thing):
        try:
            parameters[name] = await station.driver.parameters.get(name)
        except ParameterError:
            continue  # that it has none is what the rule then says
    reasons = honoured(autopilot, thing, parameters, flown_mode(autopilot, thing))
    return [f"{station.name}, {thing}: {reason}" for reason in reasons]


def _mount(vehicle: VehicleSetup, sensor: str | None) -> Pose | None:
    found = (one for one in vehicle.sensors if one.name == sensor)
    mount = getattr(next(found, None), "mount", None)
    return mount if isinstance(mount, Pose) else None
