"""What a node of px4_msgs sees of PX4: state, mode, answers; names that have a version."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.plugins.ros2.px4.definitions import DEFINITIONS, write_definitions
from wil_campaign.foundation.files.documents import KeyFaultError
from wil_campaign.plugins.ros2.messages.ros_types import RosTypes
from wil_campaign.plugins.ros2.px4.px4_types import (
    ACKNOWLEDGEMENT,
    COMMAND,
    LOCAL_POSITION,
    ODOMETRY,
    OFFBOARD_MODE,
    STATUS,
    px4_definitions,
    px4_names,
    px4_types,
)
from wil_campaign.plugins.ros2.px4.px4_vehicle import Px4Vehicle
from wil_campaign.vehicles.autonomy import Telemetry
from wil_campaign.worlds.frames import Pose

TYPES = RosTypes("jazzy", {f"px4_msgs/msg/{name}": text for name, text in DEFINITIONS.items()})
LOITER, OFFBOARD, TAKEOFF, LAND = 4, 14, 17, 18
ACCEPTED, REJECTED, UNSUPPORTED = 0, 1, 3
KINDS = {
    "/fmu/out/vehicle_status": STATUS,
    "/fmu/out/vehicle_local_position": LOCAL_POSITION,
    "/fmu/out/vehicle_odometry": ODOMETRY,
}


def message(kind: str, **fields: object) -> bytes:
    made = TYPES.zero(kind)
    for name, value in fields.items():
        setattr(made, name, value)
    return TYPES.serialize(made, kind)


def published(px4: Px4Vehicle, t_s: float) -> dict[str, Any]:
    telemetry = Telemetry(t_s, Pose.of(1.0, 2.0, 3.0, yaw_rad=0.5), (0.1, 0.2, -0.3))
    made = px4.messages(telemetry, round(t_s * 1e9) + 999)
    return {topic: TYPES.deserialize(build(), KINDS[topic]) for topic, build in made}


def states(px4: Px4Vehicle, stages: tuple[str, ...]) -> Iterator[tuple[int, int]]:
    for stage in stages:
        px4.enter(stage)
        status = published(px4, 10.0)["/fmu/out/vehicle_status"]
        yield (status.arming_state, status.nav_state)


def test_arming_and_mode_follow_from_the_stage_of_the_run() -> None:
    px4 = Px4Vehicle(TYPES)
    px4.take_mode(message(OFFBOARD_MODE, position=True), 10.0)
    found = tuple(states(px4, ("takeoff", "at_height", "goal", "done", "land", "landed")))
    armed = ((2, TAKEOFF), (2, LOITER), (2, OFFBOARD), (2, LOITER), (2, LAND))
    assert found == (*armed, (1, LOITER))


def test_the_state_is_that_of_the_vehicle_in_north_east_down() -> None:
    found = published(Px4Vehicle(TYPES), 10.0)
    place = found["/fmu/out/vehicle_local_position"]
    assert (place.x, place.y, place.z) == (1.0, 2.0, -3.0)
    assert place.xy_valid
    assert place.vxy_max == np.inf
    assert (place.heading, place.vz) == (pytest.approx(0.5), pytest.approx(-0.3))
    assert place.timestamp == 10_000_000  # microseconds
    odometry = found["/fmu/out/vehicle_odometry"]
    assert odometry.pose_frame == 1
    assert list(odometry.position) == [1.0, 2.0, -3.0]
    assert odometry.q[0] == pytest.approx(np.cos(0.25))
    assert odometry.q[3] == pytest.approx(np.sin(0.25))


def test_the_status_comes_each_half_second_and_when_it_changes() -> None:
    px4 = Px4Vehicle(TYPES)
    came = ["/fmu/out/vehicle_status" in published(px4, tick / 10) for tick in range(11)]
    assert [tick for tick, is_here in enumerate(came) if is_here] == [0, 5, 10]
    px4.enter("takeoff")
    assert "/fmu/out/vehicle_status" in published(px4, 1.1)


def test_without_its_mode_a_node_is_not_in_offboard() -> None:
    px4 = Px4Vehicle(TYPES)
    px4.enter("goal")
    assert "published no OffboardControlMode for 1 s" in px4.mode_trouble(10.0)
    px4.take_mode(message(OFFBOARD_MODE, velocity=True), 10.0)
    assert px4.mode_trouble(11.0) == ""
    assert published(px4, 11.0)["/fmu/out/vehicle_status"].nav_state == OFFBOARD
    assert px4.mode_trouble(11.1) != ""
    assert published(px4, 11.1)["/fmu/out/vehicle_status"].nav_state == LOITER


@pytest.mark.parametrize(("asked", "named"), [({"attitude": True}, "attitude"), ({}, "nothing")])
def test_a_mode_that_is_not_flown_is_named(asked: dict[str, bool], named: str) -> None:
    px4 = Px4Vehicle(TYPES)
    px4.take_mode(message(OFFBOARD_MODE, **asked), 10.0)
    assert px4.mode_trouble(10.0) == (
        f"OffboardControlMode asks for {named}: set its position or velocity"
    )


@pytest.mark.parametrize(
    ("stage", "fields", "result", "is_end"),
    [
        ("start", {"command": 400, "param1": 1.0}, ACCEPTED, False),
        ("start", {"command": 400, "param1": 0.0}, ACCEPTED, False),
        ("goal", {"command": 400, "param1": 0.0}, REJECTED, False),
        ("start", {"command": 176, "param1": 1.0, "param2": 6.0}, ACCEPTED, False),
        ("start", {"command": 176, "param1": 1.0, "param2": 3.0}, REJECTED, False),
        ("start", {"command": 22}, ACCEPTED, False),
        ("goal", {"command": 21}, ACCEPTED, True),
        ("goal", {"command": 176, "param1": 1.0, "param2": 4.0, "param3": 6.0}, ACCEPTED, True),
        ("goal", {"command": 193}, UNSUPPORTED, False),
    ],
)
def test_commands_are_answered_and_the_run_arms(
    stage: str, fields: dict[str, Any], result: int, is_end: bool
) -> None:
    px4 = Px4Vehicle(TYPES)
    px4.enter(stage if stage == "goal" else "end")
    given = message(COMMAND, timestamp=7, source_system=255, source_component=3, **fields)
    (topic, build), ended = px4.take_command(given)
    answer = TYPES.deserialize(build(), ACKNOWLEDGEMENT)
    assert topic == "/fmu/out/vehicle_command_ack"
    assert (answer.command, answer.result, ended) == (fields["command"], result, is_end)
    assert (answer.timestamp, answer.target_system, answer.target_component) == (7, 255, 3)


def test_a_topic_has_the_version_of_its_message_in_its_name() -> None:
    names = px4_names(TYPES)
    assert names["/fmu/out/vehicle_status"] == "/fmu/out/vehicle_status_v1"
    assert names["/fmu/in/trajectory_setpoint"] == "/fmu/in/trajectory_setpoint"


def test_definitions_are_found_in_the_repository_and_in_its_folder(tmp_path: Path) -> None:
    folder = write_definitions(tmp_path)
    assert px4_definitions(folder) == px4_definitions(folder / "msg")
    (folder / "msg" / "VehicleStatus.msg").unlink()
    with pytest.raises(KeyFaultError, match=r"there is no VehicleStatus\.msg in"):
        px4_definitions(folder)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("!!\n", "the definition of px4_msgs/msg/VehicleCommand is none"),
        ("float32 param1\n", r"lack VehicleCommand\.timestamp, VehicleCommand\.command, .*1\.14"),
    ],
)
def test_a_definition_that_cannot_be_used_is_named(tmp_path: Path, text: str, fault: str) -> None:
    folder = write_definitions(tmp_path)
    (folder / "msg" / "VehicleCommand.msg").write_text(text)
    with pytest.raises(KeyFaultError, match=fault):
        px4_types("jazzy", folder)
