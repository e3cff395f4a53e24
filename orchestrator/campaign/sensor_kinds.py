"""Where the readings of a campaign's sensors come from: what its results say of them."""

from campaigns.expansion.expansion import Campaign
from campaigns.setup.case_setup import VehicleSetup
from campaigns.values.sensor_setups import CameraSetup, DepthSetup, PoseSetup, SensorSetup
from orchestrator.model.campaign_results import SensorKind

_REAL_FIRST: tuple[SensorKind, ...] = ("live", "file", "rendered", "synthesised")


def sensor_kinds(campaign: Campaign) -> dict[str, SensorKind]:
    """Return the source of each sensor in the campaign that has one; of several, the most real."""
    found: dict[str, SensorKind] = {}
    for setup in campaign.setups.values():
        for vehicle in setup.vehicles.values():
            for sensor in vehicle.sensors:
                kind = _sensor_kind(vehicle, sensor)
                if kind is not None:
                    before = found.get(sensor.name, kind)
                    found[sensor.name] = min(before, kind, key=_REAL_FIRST.index)
    return found


def _sensor_kind(vehicle: VehicleSetup, sensor: SensorSetup) -> SensorKind | None:
    """Return the source of a sensor's readings; None for one of a simulated body of ours.

    Of the twin all is virtual, and of an embedded vehicle its simulation has the sensor.
    """
    if isinstance(sensor, CameraSetup):
        return "rendered" if sensor.source is None else sensor.source.shown_as
    if not isinstance(sensor, DepthSetup) and sensor.source is not None:
        return sensor.source.shown_as
    if vehicle.name != "real" or vehicle.embedded:
        return None
    return "live" if isinstance(sensor, PoseSetup) else "synthesised"
