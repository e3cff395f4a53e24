"""Nodes in processes of their own that fly in virtual time, over zenoh: time waits for them."""

import csv
import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import pytest
import yaml
from rosbags.rosbag2 import Reader

from tests.orchestrator.conftest import Fly
from tests.orchestrator.flights import all_landed, log_of
from tests.plugins.ros2.plain_node import IMAGE, STORE, Node, PictureFlight
from tests.plugins.ros2.px4.definitions import write_definitions
from tests.test_house import ROOT
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.run_results.run_result import RunResult

NODE = Path(__file__).with_name("plain_node.py")
STRAIGHT = "oracles={landed: {}, reached: {required: false}}"
"""What a node is judged by that flies ahead, and not through the gate."""


def node(behaviour: str, topics: str, start_s: float = 300) -> str:
    """Return what `--set` says of a node. topics: those that it answers. All limits are patient."""
    command = f"[{sys.executable}, {NODE}, {behaviour}]"
    barrier = f"{{topics: [{topics}], timeout_s: 25}}"
    return f"autonomy={{ros2: {{command: {command}, barrier: {barrier}, start_s: {start_s}}}}}"


def counts(result: RunResult) -> dict[str, tuple[int, int]]:
    assert result.outside is not None
    (program,) = result.outside.programs
    return {topic.topic: (topic.messages, topic.delivered) for topic in program.topics}


def test_a_node_flies_through_the_gate(fly_run: Fly) -> None:
    sets = (node("answers", "/camera/image_raw, /odom"),)
    result, folder = fly_run(mode="sim", sets=sets, has_cameras=False)
    assert result.verdict == "PASS", result.reason
    assert all_landed(folder)
    published, delivered = counts(result)["/camera/image_raw"]
    assert delivered > 100
    assert published - delivered < 40  # of those after the node's end
    assert "saw the gate in" in (folder / "twin-node.log").read_text("utf-8")


@pytest.mark.parametrize("behaviour", ["looks", "stays"])
def test_a_node_flies_the_same_way_twice(fly_run: Fly, behaviour: str) -> None:
    """It answers images and odometry, and its speed depends on all of them and on their order.

    It ends by itself, or says that it is done, and takes its time to end with the run.
    """
    sets = (node(behaviour, "/camera/image_raw, /odom"), STRAIGHT)
    flown = [fly_run(mode="sim", sets=sets, has_cameras=False) for _ in range(2)]
    for result, _ in flown:
        assert result.verdict == "PASS", result.reason
        assert counts(result)["/camera/image_raw"][1] > 10
    first, second = (folder for _, folder in flown)
    for name in ("trajectory.csv", "judged.msgpack"):
        assert (first / name).read_bytes() == (second / name).read_bytes(), name


class Played:
    """In place of a node's wire: the images of a bag, and what is published."""

    def __init__(self) -> None:
        self.call: Callable[[Any], None] = lambda _: None
        self.published = 0

    def subscribe(self, _topic: str, _kind: str, call: Callable[[Any], None]) -> None:
        self.call = call

    def publisher(self, _topic: str, _kind: str) -> Callable[[Any], None]:
        def publish(_: Any) -> None:
            self.published += 1

        return publish


def test_a_bag_played_back_into_the_same_node_gives_the_same_setpoints(fly_run: Fly) -> None:
    sets = (node("pictures", "/camera/image_raw"), STRAIGHT, "record={pictures: png}")
    result, folder = fly_run(mode="sim", sets=sets)
    assert result.verdict == "PASS", result.reason
    flown = json.loads((folder / "twin-node.log").read_text("utf-8").splitlines()[-1])
    assert main(["export", str(folder), "--ros2", str(folder / "bag.mcap"), "--decode"]) == 0
    played = Played()
    again = PictureFlight(cast("Node", played))
    with Reader(folder / "bag.mcap") as bag:
        for connection, _, data in bag.messages():
            if connection.topic == "/camera/image_raw" and not again.done:
                played.call(STORE.deserialize_cdr(data, IMAGE))
    assert played.published == len(flown) == PictureFlight.LAST
    assert [list(answer) for answer in again.answers] == flown


def test_a_node_that_breaks_in_flight_fails_the_run_with_its_last_lines(fly_run: Fly) -> None:
    result, folder = fly_run(mode="sim", sets=(node("crash", "/odom"),))
    assert result.verdict == "FAIL"
    assert "ended with exit code 1 by itself" in result.reason
    assert "RuntimeError: the node broke on its way (" in result.reason
    assert "File " not in result.reason
    assert not [one for one in result.also if "exit code" in one.reason], "told once"
    assert all_landed(folder)
    assert result.outside is not None
    assert "the node broke on its way" in result.outside.programs[0].exit


def test_a_node_with_the_topics_of_mavros_flies_by_the_map_of_the_page(fly_run: Fly) -> None:
    page = (ROOT / "docs" / "ros2.md").read_text("utf-8")
    (text,) = re.findall(r"^    topics:\n(?:      /.+\n)+", page, re.MULTILINE)
    renamed = yaml.safe_load(text)["topics"]
    sets = (
        node("mavros", "/odom"),
        f"autonomy.ros2.topics={json.dumps(renamed)}",
        STRAIGHT,
    )
    result, _ = fly_run(mode="sim", sets=sets, has_cameras=False)
    assert result.verdict == "PASS", result.reason
    assert counts(result)["/mavros/setpoint_velocity/cmd_vel"][1] > 20


def test_a_node_of_px4_msgs_arms_climbs_and_lands_by_its_commands(
    fly_run: Fly, tmp_path: Path
) -> None:
    folder = write_definitions(tmp_path)
    command = f"[{sys.executable}, {NODE}, px4, {folder}]"
    barrier = "{topics: [/fmu/out/vehicle_odometry], timeout_s: 25}"
    ros2 = f"{{command: {command}, barrier: {barrier}, px4_msgs: {folder}, start_s: 300}}"
    sets = (f"autonomy={{ros2: {ros2}}}", STRAIGHT)
    result, run_folder = fly_run(mode="sim", sets=sets, has_cameras=False)
    assert result.verdict == "PASS", result.reason
    found = counts(result)
    assert found["/fmu/in/vehicle_command"] == (3, 3)
    assert found["/fmu/out/vehicle_command_ack"] == (3, 3)
    assert found["/fmu/out/vehicle_status_v1"][1] > 5
    assert found["/fmu/in/trajectory_setpoint"][1] > 20
    rows = (run_folder / "trajectory.csv").read_text("utf-8").splitlines()
    down = [float(one["est_down_m"]) for one in csv.DictReader(rows) if one["est_down_m"]]
    assert -2.2 < min(down) < -1.9


@pytest.mark.parametrize("behaviour", ["aborts_early", "aborts_and_leaves"])
def test_a_node_aborts_at_any_stage_and_where_it_ends_itself(fly_run: Fly, behaviour: str) -> None:
    result, folder = fly_run(mode="sim", sets=(node(behaviour, "/odom"), STRAIGHT))
    assert result.verdict == "ABORTED", result.reason
    assert "asked for an abort: low battery" in result.reason
    assert all_landed(folder)
    stages = [event["stage"] for event in log_of(folder) if "stage" in event]
    assert ("goal" in stages) == (behaviour == "aborts_and_leaves")


def test_a_node_that_ends_at_once_is_named_before_anything_arms(fly_run: Fly) -> None:
    result, folder = fly_run(mode="sim", sets=(node("dead", "/odom"),))
    assert result.verdict == "ERROR", "the test did not take place"
    assert result.reason.startswith("the autonomy of twin is a node that ended with exit code 1")
    assert result.reason.endswith("before it was ready: the node has no model")
    assert not any(line.get("stage") == "takeoff" for line in log_of(folder))


def test_a_node_that_never_subscribes_is_named_before_anything_arms(fly_run: Fly) -> None:
    result, folder = fly_run(mode="sim", sets=(node("deaf", "/odom", start_s=6),))
    assert result.verdict == "ERROR"
    assert "is a node that has not subscribed to /odom within 6 s" in result.reason
    named = "the node old subscribes to /odom with nav_msgs/msg/Odometry of another ROS, whose hash"
    assert f"{named} is RIHS01_0 and not RIHS01_" in result.reason
    assert not any(line.get("stage") == "takeoff" for line in log_of(folder))


def test_a_node_that_does_not_answer_what_it_should_is_named(fly_run: Fly) -> None:
    """It answers odometry, and is asked to answer poses, to which nobody subscribes."""
    barrier = "/odom, /pose"
    result, _ = fly_run(mode="sim", sets=(node("straight", barrier, start_s=2),))
    assert result.verdict == "ERROR"
    assert "is a node that has not subscribed to " in result.reason
    assert "/pose within 2 s" in result.reason


def test_a_shadow_flies_the_setpoints_of_a_node(fly_run: Fly) -> None:
    sets = (node("straight", "/odom"), "vehicles.twin.coupling=shadow", STRAIGHT)
    result, folder = fly_run(mode="wil", sets=sets)
    assert result.verdict in {"PASS", "INVALID"}, result.reason  # it never looks at the gate
    assert "flew to" in (folder / "real-node.log").read_text("utf-8")
    assert counts(result)["/cmd_vel"][1] > 20
