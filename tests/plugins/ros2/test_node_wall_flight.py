"""Nodes that fly on the wall clock, in processes of their own: by zenoh, and by rclpy."""

import json
import os
import shutil
import sys
from pathlib import Path

import pytest

from tests.orchestrator.wall_runs import Program

NODE = Path(__file__).with_name("plain_node.py")
RCLPY_NODE = Path(__file__).with_name("rclpy_node.py")
PYTHON = os.environ.get("WIL_TEST_RCLPY", "")
"""A Python that has rclpy, sensor_msgs, nav_msgs, geometry_msgs and std_srvs."""
PATIENT_NODE = "start_s: 300, silent_s: 60"
ORACLES = "oracles={time_limit: {limit_s: 120}, landed: {}, reached: {required: false}}"


async def fly(tmp_path: Path, ros2: str) -> tuple[int | None, str, dict[str, object], Path]:
    """Fly a node ahead in mode sim; return exit code, why, the program's result and the folder."""
    words = (f"autonomy={{ros2: {ros2}}}", ORACLES, "controls={}")
    given = [word for one in words for word in ("--set", one)]
    async with Program(tmp_path / "out", "--mode", "sim", "--json", *given) as program:
        landed = await program.end()
    assert landed.out, landed.why
    (run,) = json.loads(landed.out)["runs"]
    (result,) = run["outside"]["programs"]
    return landed.code, landed.why, result, program.run_folder("sim")


async def test_a_node_flies_over_zenoh(tmp_path: Path) -> None:
    command = json.dumps([sys.executable, str(NODE), "straight"])
    code, why, result, folder = await fly(tmp_path, f"{{command: {command}, {PATIENT_NODE}}}")
    assert code == 0, why
    assert result["exit"] == "ended with exit code 0 by itself"
    topics = {one["topic"]: one for one in result["topics"]}  # type: ignore[attr-defined]  # JSON
    assert topics["/odom"]["delivered"] > 10
    assert topics["/cmd_vel"]["delivered"] > 0
    log = (folder / "twin-node.log").read_text("utf-8")
    assert log == 'flew to {"altitude_m": 1.2, "gate_count": 1} as twin\n'


@pytest.mark.skipif(shutil.which(PYTHON) is None, reason="WIL_TEST_RCLPY names no Python")
async def test_a_node_of_rclpy_sees_every_image(tmp_path: Path) -> None:
    command = json.dumps(["env", "-u", "PYTHONPATH", PYTHON, str(RCLPY_NODE)])
    ros2 = f"{{command: {command}, wire: rclpy, python: {PYTHON}, {PATIENT_NODE}}}"
    code, why, result, folder = await fly(tmp_path, ros2)
    assert code == 0, why
    topics = {one["topic"]: one for one in result["topics"]}  # type: ignore[attr-defined]  # JSON
    printed = json.loads((folder / "twin-node.log").read_text("utf-8"))
    assert json.loads(printed["goal"])["altitude_m"] == 1.2  # by the service
    images = printed["images"]
    assert topics["/camera/image_raw"]["delivered"] - images <= 1  # the one after its end
    assert images > 20


@pytest.mark.skipif(shutil.which(PYTHON) is None, reason="WIL_TEST_RCLPY names no Python")
async def test_a_node_of_rclpy_aborts_by_a_service(tmp_path: Path) -> None:
    command = json.dumps(["env", "-u", "PYTHONPATH", PYTHON, str(RCLPY_NODE), "abort"])
    ros2 = f"{{command: {command}, wire: rclpy, python: {PYTHON}, {PATIENT_NODE}}}"
    code, why, _, _ = await fly(tmp_path, ros2)
    assert code == 4, why
    assert "asked for an abort: by the service /wil/abort" in why


@pytest.mark.skipif(shutil.which(PYTHON) is None, reason="WIL_TEST_RCLPY names no Python")
async def test_subscriptions_of_rclpy_that_do_not_match_are_named(tmp_path: Path) -> None:
    command = json.dumps(["env", "-u", "PYTHONPATH", PYTHON, str(RCLPY_NODE), "mismatched"])
    ros2 = f"{{command: {command}, wire: rclpy, python: {PYTHON}, start_s: 20}}"
    sets = ("--set", f"autonomy={{ros2: {ros2}}}", "--set", "controls={}")
    async with Program(tmp_path / "out", "--mode", "sim", "--json", *sets) as program:
        landed = await program.end()
    assert landed.code == 3, landed.why
    named = "subscribes to /pose with geometry_msgs/msg/TwistStamped, not geometry_msgs/msg/Pose"
    assert f"the node mismatched {named}" in landed.why
    assert "subscribes to /odom with another quality of service: ERROR: Best" not in landed.why
    assert "subscribes to /odom with another quality of service: " in landed.why
