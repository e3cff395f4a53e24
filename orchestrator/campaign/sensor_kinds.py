"""Which source each sensor of a campaign has, as its results name it: live, file, rendered."""

from wil_campaign.campaigns.expansion.expansion import Campaign
from wil_campaign.campaigns.setup.case_setup import VehicleSetup
from wil_campaign.campaigns.values.sensor_setups import CameraSetup, SensorSetup
from wil_campaign.orchestrator.run_results.campaign_results import SensorKind

_REAL_FIRST: tuple[SensorKind, ...] = ("live", "file", "rendered", "synthesised")


def sensor_kinds(campaign: Campaign) -> dict[str, SensorKind]:
    """Return the source of each sensor in the campaign that has one; of several, the most real."""
    kinds: dict[str, SensorKind] = {}
    for setup in campaign.setups.values():
        for vehicle in setup.vehicles.values():
            for sensor in vehicle.sensors:
                kind = _sensor_kind(vehicle, sensor)
                if kind is not None:
                    before = kinds.get(sensor.name, kind)
                    kinds[sensor.name] = min(before, kind, key=_REAL_FIRST.index)
    return kinds


def _sensor_kind(vehicle: VehicleSetup, sensor: SensorSetup) -> SensorKind | None:
    """Return the source of a sensor's readings; None for a sensor of a simulated vehicle.

    All sensors of the twin are virtual, and those of an embedded vehicle are in its simulation.
    """
    if isinstance(sensor, CameraSetup):
        return "rendered" if sensor.source is None else sensor.source.shown_as
    if sensor.source is not None:
        return sensor.source.shown_as
    if vehicle.name != "real" or vehicle.embedded:
        return None
    return "live" if sensor.kind == "pose" else "synthesised"
