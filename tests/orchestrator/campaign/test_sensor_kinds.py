"""What results say of a campaign's sensors: who measured, drew or made up their readings."""

from pathlib import Path

from tests.orchestrator.wall import write_wall
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.orchestrator.campaign.sensor_kinds import sensor_kinds
from wil_campaign.orchestrator.run_results.campaign_results import SensorKind

CAMERA = "{type: camera, rate_hz: 15, width_px: 320, height_px: 240, fov_deg: 69}"
SENSORS = f"{{lidar: {{type: lidar}}, gps: {{type: gps}}, camera: {CAMERA}}}"


def kinds(folder: Path, *vehicles: str) -> dict[str, SensorKind]:
    """Return the kinds of sensors of a campaign with such vehicles."""
    path = write_wall(folder)
    lines = "".join(f"  {line}\n" for line in vehicles)
    old = "vehicles: {twin: {link: embedded, autopilot: ardupilot}}\n"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, f"vehicles:\n{lines}"))
    return sensor_kinds(load_campaign(path, ExpansionOptions()))


TWIN = "twin: {link: embedded, autopilot: px4}"


def test_readings_computed_for_an_attached_vehicle_are_synthesised(tmp_path: Path) -> None:
    link = "udpin://0.0.0.0:14540"
    assert kinds(
        tmp_path, f"real: {{link: '{link}', autopilot: px4, sensors: {SENSORS}}}", TWIN
    ) == {"lidar": "synthesised", "gps": "synthesised", "camera": "rendered"}


def test_a_simulation_of_ours_has_its_sensors_itself(tmp_path: Path) -> None:
    seeing = f"link: embedded, autopilot: px4, sensors: {SENSORS}"
    assert kinds(tmp_path, f"real: {{{seeing}}}", f"twin: {{{seeing}}}") == {"camera": "rendered"}


def test_readings_that_an_attached_vehicle_sends_are_live(tmp_path: Path) -> None:
    link = "udpin://0.0.0.0:14540"
    own = "gps: {type: gps, source: mavlink}, imu: {type: imu, source: mavlink}"
    sensors = f"{{{own}, lidar: {{type: lidar}}}}"
    assert kinds(
        tmp_path, f"real: {{link: '{link}', autopilot: px4, sensors: {sensors}}}", TWIN
    ) == {"gps": "live", "imu": "live", "lidar": "synthesised"}
