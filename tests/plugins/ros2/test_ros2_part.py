"""What a campaign may say of a node, and what is found wrong without starting it."""

from pathlib import Path
from typing import Any

import pytest

from tests.orchestrator.hover import write_hover
from tests.plugins.ros2.px4.definitions import write_definitions
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.campaigns.schema import campaign_model
from wil_campaign.foundation.files.documents import BadInput
from wil_campaign.orchestrator.cli.clock_choice import campaign_clock_for, shared_resources_of
from wil_campaign.plugins.ros2.domains import claimed_domain
from wil_campaign.plugins.ros2.rclpy_wire import open_rclpy
from wil_campaign.plugins.ros2.ros2_part import Ros2Part
from wil_campaign.plugins.ros2.wire import WireError


def node_file(tmp_path: Path, text: str) -> Path:
    """Return a campaign whose autonomy is a node. text: the value of `ros2`."""
    file = write_hover(tmp_path)
    source = file.read_text("utf-8")
    old = next(line for line in source.splitlines() if line.startswith("autonomy:"))
    file.write_text(source.replace(old, f"autonomy: {{ros2: {text}}}"), "utf-8")
    return file


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("{}", "give one of command: [PROGRAM, ...], run:"),
        ("{command: [a], launch: b.py}", "there are command, launch"),
        ("{command: [no-such-program]}", "there is no program 'no-such-program'"),
        ("{command: [./no.py]}", "there is no program './no.py'"),
        ("{command: [./plain.txt]}", "'./plain.txt' is not executable: chmod +x it"),
        ("{found: true}", "give the domain of the node, too"),
        ("{command: [sh], domain: 102}", "101"),
        ("{command: [sh], topics: {cmd_vel: /a}}", "'cmd_vel' is no topic"),
        ("{command: [sh], topics: {/cmd_vel: /a b}}", "'/a b' is no topic"),
        ("{command: [sh], barrier: {topics: []}}", "barrier"),
        ("{command: [sh], python: p}", "has no effect with the wire zenoh"),
        ("{command: [sh], wire: rclpy, python: no-python}", "there is no program 'no-python'"),
        ("{command: [sh], nodes: 2}", "nodes"),
        ("{run: [package, executable]}", "source the setup.bash of ROS 2 first"),
        ("{command: [sh, nod.py]}", "there is no file 'nod.py'"),
        (
            "{command: [sh], needs: [/odom, /odm]}",
            "nothing is published on '/odm'; did you mean '/odom'",
        ),
        (
            "{command: [sh], barrier: {topics: [/lidar/scan]}}",
            "nothing is published on '/lidar/scan'",
        ),
        (
            "{command: [sh], topics: {/cmd_vell: /a}}",
            "is no topic of the run, so it cannot be renamed or left out; did you mean '/cmd_vel'",
        ),
        ("{command: [sh], topics: {/camera/image: /rgb}}", "'/camera/image' is no topic of the"),
        ("{command: [sh], topics: {/odom: null}, needs: [/odom]}", "published on '/odom'"),
        ("{command: [sh], topics: {/pose: /odom}}", "'/odom' is the name of /odom, too"),
        ("{command: [sh], topics: {/pose: /a, /odom: /a}}", "'/a' is the name of /odom, too"),
        ("{command: [sh], topics: {/cmd_vel: /a, /setpoint/pose: /a}}", "name of /cmd_vel, too"),
        ("{command: [sh], px4_msgs: no}", "name the folder of px4_msgs, of the release"),
        ("{command: [sh], px4_msgs: bad}", "the definition of px4_msgs/msg/VehicleStatus is none"),
        ("{command: [sh], needs: [/fmu/out/vehicle_status]}", "published on '/fmu/out/vehicle_s"),
        ("{launch: no.launch.py}", "there is no file 'no.launch.py' beside the campaign"),
    ],
)
def test_faults_are_named_before_anything_starts(tmp_path: Path, text: str, fault: str) -> None:
    file = node_file(tmp_path, text)
    (tmp_path / "plain.txt").write_text("")
    bad = write_definitions(tmp_path).rename(tmp_path / "bad")
    (bad / "msg" / "VehicleStatus.msg").write_text("!!\n")
    with pytest.raises(BadInput) as caught:
        load_campaign(file)
    assert fault in str(caught.value)
    assert f"{file}:" in str(caught.value)


def test_names_may_be_swapped_and_a_twist_may_have_that_of_the_other(tmp_path: Path) -> None:
    topics = "{/pose: /odom, /odom: /pose, /cmd_vel_unstamped: /cmd_vel}"
    assert load_campaign(node_file(tmp_path, f"{{command: [sh], topics: {topics}}}"))


def test_two_sensors_with_the_same_topics_are_refused(tmp_path: Path) -> None:
    file = node_file(tmp_path, "{command: [sh]}")
    ranger = "{type: rangefinder, rate_hz: 10}"
    sets = [f"vehicles.twin.sensors.down-{name}={ranger}" for name in ("a", "b")]
    assert load_campaign(file, ExpansionOptions(sets=tuple(sets)))
    sets.append(f"vehicles.twin.sensors.down_a={ranger}")
    with pytest.raises(BadInput, match="'down_a' has the topics of 'down-a' in ROS"):
        load_campaign(file, ExpansionOptions(sets=tuple(sets)))


def test_use_beside_a_node_is_refused(tmp_path: Path) -> None:
    for beside in ("use: gate", "limits: {memory_mb: 100}"):
        file = node_file(tmp_path, f"{{command: [sh]}}, {beside}")
        with pytest.raises(BadInput, match="has no effect with a ROS 2 node"):
            load_campaign(file)


def test_a_node_has_a_rate_and_the_limit_of_a_call_and_is_not_built(tmp_path: Path) -> None:
    file = node_file(tmp_path, "{command: [sh]}, rate_hz: 10, limits: {call_s: 20}")
    (setup,) = load_campaign(file).setups.values()
    assert (setup.under_test.rate_hz, setup.under_test.limits.call_s) == (10, 20)
    file = node_file(tmp_path, "{command: [sh]}, limits: {build_s: 20}")
    with pytest.raises(BadInput, match="build_s"):
        load_campaign(file)


@pytest.mark.parametrize(
    ("text", "clock", "shared"),
    [
        ("{command: [sh]}", "wall", ()),
        ("{command: [sh], barrier: {topics: [/odom]}}", "virtual", ()),
        ("{found: true, domain: 3}", "wall", ("the ROS 2 node in domain 3",)),
    ],
)
def test_the_clock_follows_from_what_time_waits_for(
    tmp_path: Path, text: str, clock: str, shared: tuple[str, ...]
) -> None:
    campaign = load_campaign(node_file(tmp_path, text))
    assert campaign_clock_for(campaign, None) == clock
    assert shared_resources_of(campaign) == shared


def test_a_node_without_a_barrier_does_not_fly_in_virtual_time(tmp_path: Path) -> None:
    campaign = load_campaign(node_file(tmp_path, "{command: [sh]}"))
    with pytest.raises(
        BadInput, match=r"the ROS 2 node sh \(without a barrier\) runs in real time"
    ):
        campaign_clock_for(campaign, "virtual")


@pytest.mark.parametrize(
    ("given", "argv"),
    [
        ({"command": ["python3", "n.py"]}, ("python3", "n.py")),
        ({"run": ["pkg", "node"]}, ("ros2", "run", "pkg", "node")),
        ({"run": ["pkg", "node", "-p", "a:=1"]}, ("ros2", "run", "pkg", "node", "-p", "a:=1")),
        ({"launch": "a.launch.py"}, ("ros2", "launch", "a.launch.py")),
        ({"found": True, "domain": 0}, ()),
    ],
)
def test_how_a_node_is_started(given: dict[str, Any], argv: tuple[str, ...]) -> None:
    assert Ros2Part.model_validate(given).argv == argv


def test_the_model_of_campaigns_has_the_key() -> None:
    assert "ros2" in campaign_model().model_fields["autonomy"].annotation.model_fields  # type: ignore[union-attr]  # a class


def test_two_runs_never_have_one_domain() -> None:
    with claimed_domain(None) as first, claimed_domain(None) as second:
        assert first != second
        with (
            pytest.raises(WireError, match=f"domain {first} of ROS is in use by another run"),
            claimed_domain(first),
        ):
            pass
    with claimed_domain(first) as again:
        assert again == first


async def test_a_python_without_rclpy_is_named(tmp_path: Path) -> None:
    """As ROS is absent, or its setup.bash was not sourced: nothing is armed."""
    python = tmp_path / "python"
    python.write_text("#!/bin/sh\necho \"ModuleNotFoundError: No module named 'rclpy'\"\nexit 1\n")
    python.chmod(0o755)
    fault = "rclpy does not start .ended with exit code 1.*: ModuleNotFoundError.*autonomy.ros2.pyt"
    with pytest.raises(WireError, match=fault):
        async with open_rclpy(str(python), domain=3, folder=tmp_path, log=tmp_path / "log"):
            pass


def test_without_the_extra_the_wire_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("wil_campaign.plugins.ros2.ros2_part.find_spec", lambda _: None)
    monkeypatch.setattr("wil_campaign.plugins.ros2.ros2_autonomy.find_spec", lambda _: None)
    with pytest.raises(BadInput, match=r"needs rosbags and zenoh: pip install 'wil-campaign\[ros2"):
        load_campaign(node_file(tmp_path, "{command: [sh]}"))
