"""An attached vehicle whose sensors are read over real sockets: its own link, and a program's."""

import asyncio
import json
from pathlib import Path

import pytest

from tests.orchestrator.campaign.test_attached_run import outside, words
from tests.orchestrator.wall_runs import SHORT, Program
from tests.plugins.readings.publisher import Publisher, publishing
from tests.ports import free_port
from wil_campaign.plugins.lidar.rangefinder import LOOKING_DOWN
from wil_campaign.vehicles.autopilots.autopilot import MessageRate, TelemetryRates
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.links.link_factory import open_link
from wil_campaign.vehicles.links.link_strings import parse_link
from wil_campaign.vehicles.mavlink.names import message_number
from wil_campaign.vehicles.readings import GpsReading, reading_types
from wil_campaign.vehicles.readings.checks import reading_rest_fault
from wil_campaign.vehicles.sources.readings.live_readings import LiveReadings
from wil_campaign.vehicles.sources.readings.mavlink_messages import (
    MavlinkSensor,
    mavlink_reading,
)
from wil_campaign.vehicles.sources.readings.mavlink_readings import MavlinkReadings
from wil_campaign.worlds.frames import AT_ORIGIN
from wil_campaign.worlds.geodesy import LocalFrame

RECIPE = """\
schema: wil/recipe/1
sensors: {below: {type: rangefinder}, imu: {type: imu}}
combine:
  - {sensor: below, merge: {aggregate: {by: min}}, publish: [real, twin]}
  - {sensor: imu, merge: {aggregate: {by: mean}}, publish: [real, twin]}
"""


@pytest.fixture(autouse=True)
def _own_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


@pytest.mark.no_turn("flies nothing")
@pytest.mark.parametrize(
    ("autopilot", "kind", "message"),
    [
        ("px4", "rangefinder", "DISTANCE_SENSOR"),
        ("px4", "imu", "HIGHRES_IMU"),
        ("ardupilot", "imu", "RAW_IMU"),
        ("ardupilot", "gps", "GPS_RAW_INT"),
    ],
)
async def test_requested_readings_come_over_the_socket_of_the_vehicle(
    autopilot: str, kind: str, message: str
) -> None:
    """No flight: however slow the machine is, what comes is read, stamped and plausible."""
    port = free_port()
    live = LiveReadings(name=kind, what=message, stall_s=60.0)
    feed = MavlinkReadings(
        sensor=MavlinkSensor(message=message, mount=LOOKING_DOWN),
        side="real",
        into=live,
        read=mavlink_reading(kind),
    )
    line = MessageRate(message_number(message), 20.0, required=False)
    rates = TelemetryRates(position_hz=10.0, attitude_hz=10.0, sensors=(line,))
    async with outside(f"udpout://127.0.0.1:{port}", autopilot):
        link = open_link(parse_link(f"udpin://127.0.0.1:{port}"))
        async with Driver(name="real", link=link, rates=rates) as driver:
            feed.attach(driver)
            await driver.identify(60.0)
            found = [await anext(live) for _ in range(20)]
    assert {type(one) for one in found} == {reading_types()[kind]}
    assert [one.t_s for one in found] == sorted({one.t_s for one in found})
    assert all(one.t_s <= one.arrived_s for one in found)
    newest, frame = found[-1], LocalFrame(47.4, 8.5, 488.0)
    if isinstance(newest, GpsReading):
        frame = LocalFrame(newest.latitude_deg, newest.longitude_deg, newest.altitude_m)
    assert reading_rest_fault(newest, pose=AT_ORIGIN, frame=frame) is None


async def test_an_attached_vehicle_s_own_sensors_and_a_program_s_are_flown_by(
    tmp_path: Path,
) -> None:
    port, publisher = free_port(), Publisher()
    (tmp_path / "recipe.yaml").write_text(RECIPE)
    sensors = "below: {type: rangefinder, rate_hz: 20%s}, imu: {type: imu, rate_hz: 50%s}"
    ear = f"ear: {{type: microphone, source: {{address: '{publisher.address}', name: one}}}}"
    sets = words(
        vehicles__real__link=f"udpin://127.0.0.1:{port}",
        vehicles__real__pose_source="mavlink",
        vehicles__real__sensors=f"{{{sensors % ((', source: mavlink',) * 2)}, {ear}}}",
        vehicles__twin__sensors=f"{{{sensors % ('', '')}}}",
        recipe=str(tmp_path / "recipe.yaml"),
        sync__takeoff_tolerance_m="0.3",
        preflight__failsafe="set",
    )
    arguments = ("--mode", "wil", "--json", "--arm-real", *SHORT, *sets)
    sending = asyncio.create_task(publishing(publisher, "microphone", hz=30.0))
    async with (
        outside(f"udpout://127.0.0.1:{port}", "px4"),
        Program(tmp_path / "out", *arguments, has_cameras=False) as program,
    ):
        landed = await program.end()
    sending.cancel()
    publisher.close()
    assert landed.code == 0, landed.why
    summary = json.loads(landed.out)
    assert summary["sensors"] == {"below": "live", "imu": "live", "ear": "live"}
    (run,) = summary["runs"]
    sources = {one["sensor"]: one for one in run["outside"]["sources"]}
    assert set(sources) == {"below", "imu", "ear"}
    assert min(source["delivered"] for source in sources.values()) > 50
