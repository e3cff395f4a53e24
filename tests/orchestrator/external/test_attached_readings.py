"""An attached vehicle whose sensors are read over real sockets: its own link, and a program's."""

import asyncio
import json
from pathlib import Path

import pytest

from tests.orchestrator.campaign.test_attached_run import free_port, outside, words
from tests.orchestrator.wall_runs import SHORT, Program
from tests.vehicles.sources.readings.publisher import Publisher, publishing

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
    assert min(one["delivered"] for one in sources.values()) > 50
