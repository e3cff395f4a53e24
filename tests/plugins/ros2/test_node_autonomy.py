"""A node as an autonomy, on a wire that a test moves: what it is sent, and what it may answer."""

import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wil_campaign.orchestrator.run.perception.autonomy_calls import AutonomyFault
from wil_campaign.plugins.ros2.messages.ros_messages import (
    IMAGE,
    ODOMETRY,
    TEXT,
    TWIST,
    RosMessages,
)
from wil_campaign.plugins.ros2.messages.ros_types import ros_types
from wil_campaign.plugins.ros2.messages.topics import OWN, SETPOINTS, WORDS, OutTopic, sensor_topics
from wil_campaign.plugins.ros2.node_autonomy import NodeAutonomy, NodeRules
from wil_campaign.plugins.ros2.node_flight import setpoint_topics
from wil_campaign.plugins.ros2.node_topics import NodeTopics
from wil_campaign.plugins.ros2.ros2_part import Ros2Part
from wil_campaign.plugins.ros2.setpoint_inbox import InTopic, SetpointInbox
from wil_campaign.plugins.ros2.wire import InMessage, Take
from wil_campaign.vehicles.autonomy import Command, Telemetry
from wil_campaign.vehicles.readings import CameraReading
from wil_campaign.vehicles.setpoints import VelocitySetpoint
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose

TYPES = ros_types("jazzy")
EPOCH_S = 1_000_000.0
LENS = Intrinsics(8, 6, 5.0, 5.0, 3.5, 2.5)
STILL = VelocitySetpoint((0.0, 0.0, 0.0))


class FakeWire:
    """Subscribed to what a test says. answer: called with each message that is published."""

    def __init__(self) -> None:
        self.subscribed = {"/odom", "/camera/image_raw", "/clock"}
        self.published: list[tuple[str, bytes]] = []
        self.takes: dict[str, Take] = {}
        self.takes_messages, self.broken = True, ""
        self.answer: Callable[[str, bytes], None] = lambda *_: None

    def advertise(self, topic: OutTopic, name: str) -> None:
        assert topic.name

    def listen(self, name: str, type_: str, take: Take) -> None:
        self.takes[name] = take

    def is_subscribed(self, name: str) -> bool:
        return name in self.subscribed

    def publish(self, name: str, cdr: bytes, stamp_ns: int) -> bool:
        self.published.append((name, cdr))
        self.answer(name, cdr)
        return self.takes_messages

    def mismatches(self) -> list[str]:
        return []

    def trouble(self) -> str:
        return self.broken

    def environment(self) -> Mapping[str, str]:
        return {}

    def close(self) -> None: ...


PRINTED = "; the node python3 node.py printed last: its last line"


class FakeNode:
    name = "python3 node.py"

    def __init__(self) -> None:
        self.exit_code: int | None = None

    @property
    def has_ended(self) -> bool:
        return self.exit_code is not None

    @property
    def ending(self) -> str:
        return f"{self}: {self.last_lines()}"

    def last_lines(self) -> str:
        return "its last line"

    def __str__(self) -> str:
        return f"ended with exit code {self.exit_code} by itself"


class Rig:
    def __init__(self, rules: NodeRules | None = None, renamed: str = "/cmd_vel") -> None:
        self.wire, self.node = FakeWire(), FakeNode()
        topics = (*OWN, *sensor_topics("camera", "camera", compressed=False))
        self.topics = NodeTopics(self.wire, topics, {})
        names = {"/cmd_vel": renamed}
        self.inbox = SetpointInbox(
            {
                names.get(name, name): InTopic(name, kind)
                for name, kind in {**SETPOINTS, **WORDS}.items()
            }
        )
        self.blind: list[str] = []
        self.cut: list[str] = []
        self.aborts: list[str] = []
        self.autonomy = NodeAutonomy(
            topics=self.topics,
            inbox=self.inbox,
            types=TYPES,
            node=self.node,  # type: ignore[arg-type]  # as much of one as it uses
            sensors=(),
            epoch_s=EPOCH_S,
            rules=rules or NodeRules(),
            decide_blind=self.blind.append,
            decide_cut=self.cut.append,
            abort=self.aborts.append,
        )

    def act(self, t_s: float) -> Command:
        return self.autonomy.act(telemetry(t_s))

    def send(
        self, t_s: float | None, *linear: float, sender: str = "a", topic: str = "/cmd_vel"
    ) -> None:
        stamp_ns = 0 if t_s is None else round((EPOCH_S + t_s) * 1e9)
        self.inbox.receive(InMessage(topic, TWIST, twist(stamp_ns, *linear), sender))

    def published(self, topic: str) -> list[Any]:
        kinds = {"/odom": ODOMETRY, "/camera/image_raw": IMAGE}
        return [
            TYPES.deserialize(cdr, kinds[topic])
            for name, cdr in self.wire.published
            if name == topic
        ]


def telemetry(t_s: float) -> Telemetry:
    return Telemetry(t_s, Pose((1.0, 2.0, -3.0)), (0.0, 0.0, 0.0))


def twist(stamp_ns: int, *linear: float) -> bytes:
    def of(name: str, *fields: object) -> Any:
        return TYPES.cls(name)(*fields)

    stamp = of("builtin_interfaces/msg/Time", stamp_ns // 10**9, stamp_ns % 10**9)
    zero = of("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
    moved = of("geometry_msgs/msg/Vector3", *(linear or (1.0, 0.0, 0.0)))
    body = of("geometry_msgs/msg/Twist", moved, zero)
    return TYPES.serialize(of(TWIST, of("std_msgs/msg/Header", stamp, "map"), body), TWIST)


def camera(t_s: float) -> CameraReading:
    image = np.zeros((6, 8, 3), np.uint8)
    return CameraReading(t_s, t_s, 0, "mixed", image, LENS, sensor="camera")


def test_a_setpoint_flies_until_it_is_old() -> None:
    rig = Rig()
    assert rig.act(10.0).setpoint == STILL
    rig.send(10.02, 1.0, 2.0, 3.0)
    assert rig.act(10.05).setpoint == VelocitySetpoint((2.0, 1.0, -3.0))
    assert rig.act(10.5).setpoint == VelocitySetpoint((2.0, 1.0, -3.0))
    assert rig.act(10.6).setpoint == STILL


def test_a_setpoint_without_a_stamp_counts_when_it_comes() -> None:
    rig = Rig()
    rig.act(10.0)
    rig.send(None, 1.0, 0.0, 0.0)
    assert rig.act(10.05).setpoint == VelocitySetpoint((0.0, 1.0, 0.0))


def test_a_setpoint_before_the_goal_flies_nothing() -> None:
    rig = Rig()
    rig.send(10.0, 1.0, 0.0, 0.0)
    assert rig.act(10.0).setpoint == STILL
    assert rig.act(10.05).setpoint == STILL


def test_the_newest_of_a_thousand_setpoints_a_second_flies() -> None:
    rig = Rig()
    rig.act(10.0)
    for i in range(1000):
        rig.send(10.0 + i / 1000, float(i), 0.0, 0.0)
    assert rig.act(11.0).setpoint == VelocitySetpoint((0.0, 999.0, 0.0))
    assert rig.inbox.topics["/cmd_vel"].received == 1000
    assert rig.inbox.topics["/cmd_vel"].used == 1
    assert rig.inbox.topics["/cmd_vel"].refused == 0, "newer ones replaced the others"


@pytest.mark.parametrize(("late_s", "text"), [(-3.0, "3.0 s old"), (3.0, "3.0 s ahead of /clock")])
def test_setpoints_from_another_time_fail_the_node_in_the_end(late_s: float, text: str) -> None:
    rig = Rig()
    for tick in range(100):
        t_s = 10.0 + tick / 20
        rig.send(t_s + late_s, 1.0, 0.0, 0.0)
        assert rig.act(t_s).setpoint == STILL
    with pytest.raises(AutonomyFault, match=text):
        rig.act(15.1)
    assert rig.inbox.topics["/cmd_vel"].refused == 99, "the first came before its goal"


def test_a_wire_that_has_ended_decides_before_the_node_is_found_silent() -> None:
    rig = Rig()
    rig.act(10.0)
    assert not rig.cut
    rig.wire.broken = "the relay was ended by SIGKILL"
    rig.act(10.05)
    assert rig.cut == ["the relay was ended by SIGKILL"]


@pytest.mark.parametrize("taken", [True, False], ids=["sent", "not sent"])
def test_nobody_waits_for_an_answer_over_a_wire_that_has_ended(*, taken: bool) -> None:
    rig = barrier_rig()
    rig.wire.takes_messages, rig.wire.broken = taken, "gone"
    rig.autonomy.perceive(camera(10.0))
    assert "gone" in rig.cut


def test_a_node_that_says_nothing_fails() -> None:
    rig = Rig(NodeRules(silent_s=2.0))
    rig.act(10.0)
    rig.act(12.0)
    with pytest.raises(
        AutonomyFault, match=r"no setpoint that can be used for 2\.1 s: it publ.*" + PRINTED
    ):
        rig.act(12.1)


def test_a_setpoint_that_is_no_number_fails_the_node() -> None:
    rig = Rig()
    rig.act(10.0)
    rig.send(10.0, float("nan"), 0.0, 0.0)
    with pytest.raises(AutonomyFault, match=r"setpoint on /cmd_vel that is not finite: linear\.x"):
        rig.act(10.05)


def test_bytes_that_are_no_message_fail_the_node() -> None:
    rig = Rig()
    rig.act(10.0)
    rig.inbox.receive(InMessage("/cmd_vel", TWIST, b"\0\1\0\0" + bytes(3)))
    with pytest.raises(AutonomyFault, match="that is no geometry_msgs/msg/TwistStamped"):
        rig.act(10.05)


def test_messages_of_another_type_are_named() -> None:
    rig = Rig(NodeRules(silent_s=1.0))
    rig.act(10.0)
    rig.inbox.receive(InMessage("/cmd_vel", "geometry_msgs/msg/Twist", b"\0\1\0\0"))
    named = "/cmd_vel cannot be used: it has geometry_msgs/msg/Twist, not geometry_msgs/msg/TwistS"
    assert rig.inbox.troubles()[0].startswith(named)
    with pytest.raises(AutonomyFault, match=named):
        rig.act(11.5)


def test_two_publishers_of_setpoints_are_named() -> None:
    rig = Rig()
    rig.act(10.0)
    rig.send(10.0, 1.0, 0.0, 0.0, sender="a")
    rig.act(10.05)
    rig.send(10.05, 1.0, 0.0, 0.0, sender="b")
    with pytest.raises(AutonomyFault, match="2 publishers publish on /cmd_vel"):
        rig.act(10.1)


def test_a_publisher_is_known_before_it_says_anything() -> None:
    rig = Rig()
    rig.inbox.receive(InMessage("/cmd_vel", "geometry_msgs/msg/Twist", None, "a"))
    assert rig.inbox.topics["/cmd_vel"].received == rig.inbox.topics["/cmd_vel"].refused == 0
    assert len(rig.inbox.troubles()) == 1


def test_telemetry_and_clock_are_published_with_stamps_of_utc() -> None:
    rig = Rig()
    rig.act(10.0)
    (odometry,) = rig.published("/odom")
    assert odometry.header.stamp.sec == 1_000_010
    assert odometry.pose.pose.position.x == 2.0
    names = [name for name, _ in rig.wire.published]
    assert names == ["/clock", "/odom"]  # what nobody subscribes to is not made


def test_the_telemetry_of_one_time_is_published_once() -> None:
    rig = Rig()
    rig.autonomy.report(telemetry(9.9))
    for t_s in (9.9, 10.0, 10.0, 10.1):
        rig.act(t_s)
    stamps = [one.header.stamp for one in rig.published("/odom")]
    assert [round(stamp.sec + stamp.nanosec / 1e9 - EPOCH_S, 3) for stamp in stamps] == [
        9.9,
        10.0,
        10.1,
    ]


def test_the_clock_does_not_go_back_for_an_image_that_is_older() -> None:
    rig = Rig()
    rig.act(10.0)
    rig.autonomy.perceive(camera(9.9))
    rig.autonomy.perceive(camera(10.1))
    assert [name for name, _ in rig.wire.published].count("/clock") == 2
    assert [one.header.stamp.nanosec for one in rig.published("/camera/image_raw")] == [
        900_000_000,
        100_000_000,
    ]


def test_unmixed_readings_have_topics_of_their_own_where_they_are_offered() -> None:
    rig = Rig()
    rig.wire.subscribed.add("/real/camera/image_raw")
    rig.autonomy.perceive_raw(camera(10.0))
    assert rig.published("/camera/image_raw") == []  # nobody offered /mixed/camera


def test_a_blind_node_is_invalid_and_not_a_bad_one() -> None:
    rig = Rig()
    rig.autonomy.need(["/camera/image_raw"])
    for tick in range(60):
        t_s = 10.0 + tick / 20
        rig.autonomy.perceive(camera(t_s))
        if tick == 20:
            rig.wire.subscribed.remove("/camera/image_raw")
        rig.send(t_s, 1.0, 0.0, 0.0)
        rig.act(t_s)
    assert rig.blind == []  # half a second more than half of two
    for tick in range(60, 90):
        t_s = 10.0 + tick / 20
        rig.autonomy.perceive(camera(t_s))
        rig.send(t_s, 1.0, 0.0, 0.0)
        rig.act(t_s)
    assert rig.blind == ["0 of 40 messages on /camera/image_raw in 2.0 s found a subscriber"]


def test_messages_that_the_wire_refuses_are_counted() -> None:
    rig = Rig()
    rig.wire.takes_messages = False
    rig.act(10.0)
    result = next(one for one in rig.topics.results() if one.topic == "/odom")
    assert (result.messages, result.delivered) == (1, 0)
    assert result.trouble == "the wire refused some of them"


def test_a_node_gives_its_note_abort_and_end() -> None:
    rig, make = Rig(), RosMessages(TYPES)
    for topic, text in (("/wil/note", "search"), ("/wil/abort", "low battery"), ("/wil/done", "")):
        rig.inbox.receive(InMessage(topic, TEXT, make.text(text)))
    command = rig.act(10.0)
    assert (command.note, command.done, rig.aborts) == ("search", True, ["low battery"])


def test_a_node_that_ends_well_is_done() -> None:
    rig = Rig()
    rig.act(10.0)
    rig.node.exit_code = 0
    assert rig.act(10.05).done


def test_a_node_that_crashes_fails_with_its_last_lines() -> None:
    rig = Rig()
    rig.act(10.0)
    rig.node.exit_code = 3
    with pytest.raises(
        AutonomyFault, match="ended with exit code 3 by itself: its last line"
    ) as found:
        rig.act(10.05)
    assert found.value.kind == "ERROR"  # before its goal; from then on `decide_fault` says FAIL


def test_what_a_node_says_is_printable_and_short() -> None:
    rig, make = Rig(), RosMessages(TYPES)
    rig.inbox.receive(InMessage("/wil/abort", TEXT, make.text("\x1b[2J\n" + 900 * "a")))
    rig.act(10.0)
    assert rig.aborts == ["?[2J?" + 295 * "a"]


def test_a_frame_that_cannot_be_printed_is_named_on_one_line() -> None:
    rig = Rig()
    rig.act(10.0)
    there = twist(round((EPOCH_S + 10.05) * 1e9)).replace(b"map\0", b"\x1b\n?\0")
    rig.inbox.receive(InMessage("/cmd_vel", TWIST, there, "a"))
    with pytest.raises(AutonomyFault, match=r"is in the frame '\?\?\?': use map"):
        rig.act(10.05)


def barrier_rig(within_s: float = 10.0) -> Rig:
    topics = frozenset({"/odom", "/camera/image_raw"})
    return Rig(NodeRules(barrier=topics, barrier_s=within_s))


def stamp_of_message(topic: str, cdr: bytes) -> int:
    message = TYPES.deserialize(cdr, {"/odom": ODOMETRY, "/camera/image_raw": IMAGE}[topic])
    return int(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)


def test_time_waits_for_the_answer_to_each_message_of_the_barrier() -> None:
    rig, answered = barrier_rig(), threading.Event()

    def answer_later(topic: str, cdr: bytes) -> None:
        if topic == "/clock":
            return
        data = twist(stamp_of_message(topic, cdr), 1.0, 0.0, 0.0)

        def answer() -> None:
            answered.set()
            rig.inbox.receive(InMessage("/cmd_vel", TWIST, data, "a"))

        threading.Timer(0.05, answer).start()

    rig.wire.answer = answer_later
    assert rig.act(10.0).setpoint == VelocitySetpoint((0.0, 1.0, 0.0))
    assert answered.is_set()


@pytest.mark.parametrize("topic", ["/wil/note", "/wil/done", "/wil/abort"])
def test_a_word_after_an_answer_belongs_to_the_next_one(topic: str) -> None:
    """How soon it comes is a matter of the machine, and time goes on with the answer."""
    rig, word = barrier_rig(), RosMessages(TYPES).text("there")

    def answer(name: str, cdr: bytes) -> None:
        if name == "/odom" and not rig.inbox.newest:
            data = twist(stamp_of_message(name, cdr), 1.0, 0.0, 0.0)
            rig.inbox.receive(InMessage("/cmd_vel", TWIST, data, "a"))
            rig.inbox.receive(InMessage(topic, TEXT, word))
        elif name == "/odom" and topic == "/wil/note":
            data = twist(stamp_of_message(name, cdr), 2.0, 0.0, 0.0)
            rig.inbox.receive(InMessage("/cmd_vel", TWIST, data, "a"))

    rig.wire.answer = answer
    first = rig.act(10.0)
    assert (first.note, first.done, rig.aborts) == ("", False, [])
    # What ends the flight needs no answer: the node may be gone.
    second = rig.act(10.05)
    said = {"/wil/note": second.note, "/wil/abort": "".join(rig.aborts)}
    assert second.done if topic == "/wil/done" else said[topic] == "there"


def test_an_abort_after_the_node_is_done_is_read() -> None:
    rig, make = barrier_rig(), RosMessages(TYPES)
    rig.inbox.receive(InMessage("/wil/done", TEXT, make.text("")))
    assert rig.act(10.0).done
    rig.inbox.receive(InMessage("/wil/abort", TEXT, make.text("late")))
    rig.act(10.05)
    assert rig.aborts == ["late"]


def abort(rig: Rig, reason: str) -> None:
    rig.inbox.receive(InMessage("/wil/abort", TEXT, RosMessages(TYPES).text(reason)))


@pytest.mark.parametrize("exit_code", [0, 3])
@pytest.mark.parametrize("barrier", [True, False])
def test_an_abort_is_read_of_a_node_that_ends_after_it(exit_code: int, *, barrier: bool) -> None:
    """It said so after its answer, and is gone before the next message."""
    rig = barrier_rig(0.2) if barrier else Rig()

    def answer(name: str, _: bytes) -> None:
        if name == "/odom":
            rig.send(10.0, 1.0, 0.0, 0.0)
            abort(rig, "low battery")

    if barrier:
        rig.wire.answer = answer
    rig.act(10.0)
    if not barrier:
        abort(rig, "low battery")
    rig.wire.subscribed.clear()
    rig.node.exit_code = exit_code
    if exit_code:
        with pytest.raises(AutonomyFault, match="ended with exit code 3"):
            rig.act(10.05)
    else:
        assert rig.act(10.05).done
    assert rig.aborts == ["low battery"]


@pytest.mark.parametrize("topic", ["/wil/note", "/wil/done", "/wil/abort"])
def test_a_word_is_not_held_back_where_nothing_is_to_be_answered_any_more(topic: str) -> None:
    """The camera that time waits for has stopped."""
    rig = Rig(NodeRules(barrier=frozenset({"/camera/image_raw"}), barrier_s=0.2))

    def answer(name: str, cdr: bytes) -> None:
        if name == "/camera/image_raw":
            rig.send(10.0, 1.0, 0.0, 0.0)
            rig.inbox.receive(InMessage(topic, TEXT, RosMessages(TYPES).text("there")))

    rig.wire.answer = answer
    rig.act(9.95)
    rig.autonomy.perceive(camera(10.0))
    for tick in range(15):
        command = rig.act(10.0 + tick / 20)
        assert (command.note, command.done, rig.aborts) == ("", False, [])
    for tick in range(15, 25):
        command = rig.act(10.0 + tick / 20)
    said = {"/wil/note": command.note, "/wil/abort": "".join(rig.aborts)}
    assert command.done if topic == "/wil/done" else said[topic] == "there"


def test_a_node_that_has_aborted_owes_no_answers() -> None:
    """It may be silent from then on, and images go on while the vehicles land."""
    rig = barrier_rig(0.2)
    rig.wire.answer = lambda name, _: abort(rig, "low battery") if name == "/odom" else None
    rig.act(10.0)
    assert rig.aborts == ["low battery"]
    rig.wire.answer = lambda *_: None
    rig.autonomy.perceive(camera(10.1))
    rig.autonomy.report(telemetry(10.2))


def test_setpoints_of_other_times_are_no_answers() -> None:
    rig = barrier_rig(within_s=0.2)
    rig.wire.answer = lambda topic, _: rig.send(11.0, 1.0, 0.0, 0.0)
    with pytest.raises(AutonomyFault, match=r"1000010\.0+ of a message on /odom within 0\.2 s"):
        rig.act(10.0)


def test_an_answer_to_an_earlier_message_of_the_same_time_is_none() -> None:
    rig = barrier_rig(within_s=0.2)
    rig.send(10.0, 1.0, 0.0, 0.0)
    with pytest.raises(AutonomyFault, match=rf"copy header\.stamp of the message.*{PRINTED}"):
        rig.act(10.0)


def test_a_node_that_ends_instead_of_answering_is_done_at_the_same_time() -> None:
    rig = barrier_rig()

    def end(*_: object) -> None:
        rig.node.exit_code = 0

    rig.wire.answer = end
    assert rig.act(10.0).done


def test_the_end_of_a_node_is_noticed_at_the_next_message_that_it_has_to_answer() -> None:
    """How fast its process ends after its last answer is a matter of the machine."""
    rig = barrier_rig()
    rig.wire.answer = lambda name, _: rig.send(10.0) if name == "/odom" else None
    assert not rig.act(10.0).done
    rig.node.exit_code = 0
    rig.wire.answer = lambda *_: None
    assert not rig.act(10.0).done  # of a time that was published already
    assert rig.act(10.1).done


def test_a_node_that_no_longer_subscribes_is_waited_for() -> None:
    rig = barrier_rig()
    rig.wire.subscribed.clear()
    threading.Timer(0.1, lambda: setattr(rig.node, "exit_code", 0)).start()
    assert rig.act(10.0).done


def test_a_node_that_stays_and_no_longer_subscribes_fails() -> None:
    rig = barrier_rig(within_s=0.1)
    rig.wire.subscribed.clear()
    with pytest.raises(AutonomyFault, match=f"no longer subscribes to /odom.*{PRINTED}"):
        rig.act(10.0)


def test_after_its_goal_a_node_need_not_answer(tmp_path: Path) -> None:
    rig = barrier_rig(within_s=0.1)
    rig.autonomy.report(telemetry(10.0), is_answered=False)
    assert len(rig.published("/odom")) == 1


def test_names_of_the_campaign() -> None:
    wire = FakeWire()
    wire.subscribed = {"/rgb"}
    topics = NodeTopics(
        wire,
        sensor_topics("camera", "camera", compressed=False),
        {
            "/camera/image_raw": "/rgb",
            "/camera/camera_info": None,
        },
    )
    assert topics.publish("/camera/image_raw", 0, lambda: b"x")
    assert not topics.publish("/camera/camera_info", 0, lambda: b"x")
    assert wire.published == [("/rgb", b"x")]
    assert topics.published("/rgb") == "/camera/image_raw"
    assert topics.published("/nothing") == ""
    assert [(result.topic, result.delivered) for result in topics.results()] == [("/rgb", 1)]


def test_setpoints_come_on_the_name_of_the_campaign() -> None:
    rig = Rig(renamed="/mavros/cmd_vel")
    rig.act(10.0)
    rig.send(10.0, 1.0, 0.0, 0.0, topic="/mavros/cmd_vel")
    assert rig.act(10.05).setpoint == VelocitySetpoint((0.0, 1.0, 0.0))


def test_a_twist_without_a_stamp_flies_by_the_name_of_the_other() -> None:
    names: dict[str, str | None] = {"/cmd_vel_unstamped": "/cmd_vel"}
    part = Ros2Part(command=["node"], topics=names)
    assert setpoint_topics(part, part.topics)["/cmd_vel"].type == "geometry_msgs/msg/Twist"
    assert "/cmd_vel_unstamped" not in setpoint_topics(part, part.topics)
