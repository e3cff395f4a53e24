"""Steps that take readings of lidars, too, load where the plugin of lidars is absent."""

from pathlib import Path

from tests.test_house import ROOT
from tests.wil_campaign.test_installed_plugins import run_without

CODE = """
from wil_campaign.orchestrator.cli import main
from wil_campaign.recipes.model.registry import find_step
assert main(["validate", {gate!r}]) == 0
print(*find_step("remove_outliers").sensors, *find_step("overlay").sensors)
print(find_step("resample_beams"), find_step("add"))
"""


def test_steps_need_no_plugin_of_a_sensor(tmp_path: Path) -> None:
    code = CODE.format(gate=str(ROOT / "campaigns" / "gate.yaml"))
    done = run_without({"lidar", "microphone"}, code, tmp_path)
    *_, sensors, steps = done.stdout.splitlines()
    assert sensors == "depth lidar lidar_points camera depth pose gps imu"
    assert steps == "None None"
