"""A node as the autonomy of a vehicle: readings and telemetry out, setpoints in.

Its calls are those of any autonomy, made in the loop of a run, or in a thread beside it.
"""

import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial

from wil_campaign.campaigns.values.sensor_setups import SensorSetup
from wil_campaign.foundation.files.problems import printable_problem
from wil_campaign.orchestrator.run.perception.autonomy_calls import AutonomyFault
from wil_campaign.plugins.ros2.messages.reading_messages import (
    is_stabilized,
    reading_messages,
    sensor_frames,
    sensor_transforms,
)
from wil_campaign.plugins.ros2.messages.ros_frames import attitude_enu, enu_from_ned
from wil_campaign.plugins.ros2.messages.ros_messages import (
    BODY_FRAME,
    ODOMETRY_FRAME,
    TEXT,
    TRAJECTORY_SETPOINT,
    WORLD_FRAME,
    FrameTransform,
    RosMessages,
)
from wil_campaign.plugins.ros2.messages.ros_types import BadRosMessageError, RosTypes
from wil_campaign.plugins.ros2.messages.setpoint_messages import BadSetpointError, setpoint_of
from wil_campaign.plugins.ros2.messages.topics import (
    ABORT,
    CLOCK_TOPIC,
    DONE,
    NOTE,
    ODOMETRY_TOPIC,
    POSE_TOPIC,
    STATIC_TOPIC,
    TF_TOPIC,
)
from wil_campaign.plugins.ros2.node_process import NodeProcess
from wil_campaign.plugins.ros2.node_topics import NodeTopics
from wil_campaign.plugins.ros2.px4.px4_types import COMMAND_TOPIC, MODE_TOPIC
from wil_campaign.plugins.ros2.px4.px4_vehicle import Px4Vehicle
from wil_campaign.plugins.ros2.setpoint_inbox import ReceivedSetpoint, SetpointInbox
from wil_campaign.vehicles.autonomy import Command, Telemetry
from wil_campaign.vehicles.readings import Reading
from wil_campaign.vehicles.setpoints import Setpoint, VelocitySetpoint
from wil_campaign.worlds.frames import Pose

_NS = 1_000_000_000
_STILL = VelocitySetpoint((0.0, 0.0, 0.0))
_OLD_S = 0.5
"""After which time without a new setpoint the vehicle stops."""
_PAST_S = 1.0
"""By how much a setpoint's stamp may differ from now."""
_BLIND_S = 2.0
_LOOK_S = 0.01
_HELD_S = 1.0
"""For how long a word waits for the next answer: a camera may have stopped."""
_LONGEST_WORD = 300
"""Characters of what a node says, in the reason of a run."""
_AGAIN_S = 1.0
"""How often latched messages are published again: late subscribers of zenoh miss them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeRules:
    """What is asked of a node. barrier: topics whose messages it has to answer, by our names.

    barrier_s: wall time for an answer. silent_s: how long it may publish no setpoint.
    """

    barrier: frozenset[str] = frozenset()
    barrier_s: float = 10.0
    silent_s: float = 5.0
    compressed: bool = False


class NodeAutonomy:
    """Flies a vehicle by a node. epoch_s: UTC of the run clock's zero, of which stamps are.

    node: its process; None for one that runs already. decide_blind: called with why the node
    does not get what it needs. decide_cut: called with why the wire to it has ended. abort: called
    with the reason when the node asks for it.
    px4: what a node of px4_msgs sees of PX4; None without such topics.
    """

    def __init__(
        self,
        *,
        topics: NodeTopics,
        inbox: SetpointInbox,
        types: RosTypes,
        node: NodeProcess | None,
        sensors: tuple[SensorSetup, ...],
        epoch_s: float,
        rules: NodeRules,
        decide_blind: Callable[[str], None],
        decide_cut: Callable[[str], None],
        abort: Callable[[str], None],
        px4: Px4Vehicle | None = None,
    ) -> None:
        self._topics, self._inbox, self._types, self._node = topics, inbox, types, node
        self._make = RosMessages(types)
        self._gimbals = tuple(sensor for sensor in sensors if is_stabilized(sensor))
        self._mounts = sensor_transforms(sensors)
        self._epoch_ns = round(epoch_s * _NS)
        self._rules = rules
        self._decide_blind, self._decide_cut, self._abort = decide_blind, decide_cut, abort
        self._px4 = px4
        self._latched: dict[str, bytes] = {}
        self._latched_s = self._clock_s = float("-inf")
        self._reporting = threading.Lock()
        self._answer: ReceivedSetpoint | None = None
        self._until: int | None = None
        """Number of the setpoint before which a word must have come: of what a node says after
        its answer, the machine decides when it comes, and it belongs to the next answer."""
        self._answered_s = float("-inf")
        self._used, self._refused = 0, ""
        self._fresh_s: float | None = None
        self._setpoint: Setpoint = _STILL
        self._note = ""
        self._is_done = False
        self._owes_answers = True
        """Whether the node has to answer what the barrier names: not after its end or abort."""
        self._windows: dict[str, tuple[float, int, int]] = {}
        self._is_answered = True
        self._has_left = False
        """Whether a message that had to be answered found the node ended: then it is the same
        message each time, and no matter of how fast a process ends."""
        self.reported_s = float("-inf")
        """Of which time the newest telemetry is that was published."""
        self.acted_s = float("-inf")
        """Of which time the telemetry is of the run's newest call of `act`."""
        self.flying = False
        """Whether the run has called `act`: it publishes the telemetry then."""

    def need(self, topics: Iterable[str]) -> None:
        """Watch topics without which the node is blind."""
        self._windows = {name: (float("-inf"), 0, 0) for name in topics}

    def latch(self, topic: str, text: str) -> None:
        """Publish a text with the next telemetry, and again each second for late subscribers."""
        self._latched[topic] = self._make.text(text)
        self._latched_s = float("-inf")

    def perceive(self, reading: Reading) -> None:
        """Publish a reading, and wait for its answer where time can wait. Raises AutonomyFault."""
        self._publish_reading(reading, "")

    def perceive_raw(self, reading: Reading) -> None:
        """Publish a mixture's input beneath /real or /twin. Raises AutonomyFault."""
        self._publish_reading(reading, f"/{reading.source}")

    def act(self, telemetry: Telemetry) -> Command:
        """Publish the telemetry; return the node's setpoint. Raises AutonomyFault."""
        is_first, self.flying, self.acted_s = not self.flying, True, telemetry.t_s
        if is_first:
            self._used = self._inbox.count()  # what came before the goal flies nothing
            self._fresh_s = telemetry.t_s
            self._windows = {name: self._window(name, telemetry.t_s) for name in self._windows}
        if not self._rules.barrier and (ended := self.ended()) is not None:
            return ended
        self.report(telemetry)
        if self._has_left and (ended := self.ended()) is not None:
            return ended
        self._read_words(telemetry.t_s)
        self._answer_px4(telemetry.t_s)
        self._watch_needs(telemetry.t_s)
        self._receive_setpoint(telemetry)
        return Command(self._setpoint, self._is_done, self._note)

    def ended(self) -> Command | None:
        """Return the last command where the node has ended by itself with exit code 0.

        None while it runs. Raises AutonomyFault where it crashed: before its goal an ERROR.
        """
        if self._node is None or not self._node.has_ended:
            return None
        self.hear_abort()
        if self._node.exit_code == 0:
            return Command(_STILL, done=True, note=self._note or "the node ended")
        raise AutonomyFault(f"is a node that {self._node.ending}", kind="ERROR")

    def hear_abort(self, t_s: float = float("inf")) -> None:
        """Abort the run where the node asks for it, at any stage. Raises AutonomyFault.

        t_s: without it, of a node that has ended, all that it said counts.
        """
        if (reason := self._word(ABORT, t_s)) is not None:
            self._owes_answers = False
            self._abort(reason)

    def report(self, telemetry: Telemetry, *, is_answered: bool = True) -> None:
        """Publish the telemetry: clock, transforms, pose, odometry; and what is latched.

        Of one time it is published once: a node may divide by the time between two messages.
        is_answered: whether the node has to answer what the barrier names. Raises AutonomyFault.
        """
        self._is_cut()
        with self._reporting:
            t_s, pose = telemetry.t_s, telemetry.pose
            self._is_answered = is_answered
            if t_s <= self.reported_s:
                return
            self.reported_s = t_s
            stamp_ns = self._tick(t_s)
            if t_s - self._latched_s >= _AGAIN_S:
                self._latched_s = t_s
                self._publish_latched(stamp_ns)
            transforms = partial(self._make.transforms, self._moving(pose), stamp_ns)
            self._publish(TF_TOPIC, stamp_ns, transforms)
            self._publish(POSE_TOPIC, stamp_ns, partial(self._make.pose, pose, stamp_ns))
            velocity = telemetry.velocity_ned_m_s
            odometry = partial(self._make.odometry, pose, velocity, stamp_ns)
            self._publish(ODOMETRY_TOPIC, stamp_ns, odometry)
            for topic, build in (
                () if self._px4 is None else self._px4.messages(telemetry, stamp_ns)
            ):
                self._publish(topic, stamp_ns, build)
            if not self.flying:
                self._answer_px4(telemetry.t_s)

    def _answer_px4(self, t_s: float) -> None:
        """Take modes and commands of a node of px4_msgs, and answer these. Raises AutonomyFault."""
        if self._px4 is None:
            return
        try:
            for cdr in self._inbox.words(MODE_TOPIC, self._limit(t_s))[-1:]:
                self._px4.take_mode(cdr, t_s)
            for cdr in self._inbox.words(COMMAND_TOPIC, self._limit(t_s)):
                (topic, build), is_end = self._px4.take_command(cdr)
                self._topics.publish(topic, self._stamp(t_s), build)
                if is_end and self.flying:
                    self._is_done, self._owes_answers = True, False
        except BadRosMessageError as error:
            raise AutonomyFault(f"published to /fmu/in a message that {error}") from None

    def _publish_reading(self, reading: Reading, prefix: str) -> None:
        with self._reporting:
            stamp_ns = self._stamp(reading.t_s)
            self._tick(reading.t_s)
            made = reading_messages(
                reading, self._make, stamp_ns, prefix=prefix, compressed=self._rules.compressed
            )
            for topic, build in made:
                self._publish(topic, stamp_ns, build)

    def _publish(self, topic: str, stamp_ns: int, build: Callable[[], bytes]) -> None:
        """Publish a message; wait for its answer where it is one that is answered."""
        before = self._inbox.count()
        is_awaited = self._is_answered and self._owes_answers and topic in self._rules.barrier
        is_sent = self._topics.publish(topic, stamp_ns, build)
        if not is_awaited:
            return
        if not is_sent:
            self._await_end(topic)
            return
        answer = self._inbox.await_answer(
            stamp_ns, after=before, within_s=self._rules.barrier_s, is_gone=self._is_gone
        )
        if answer is not None:
            self._answer, self._until = answer.setpoint or self._answer, answer.until
            self._answered_s = self._clock_s
        elif not self._is_cut() and self.ended() is None:
            raise AutonomyFault(self._unanswered(topic, stamp_ns))
        else:
            self._has_left = True

    def _await_end(self, topic: str) -> None:
        """Wait for the end of a node that no longer subscribes. Raises AutonomyFault if it stays.

        Whether it has ended by now is a matter of the machine, and time stands still for it.
        """
        until_s = time.monotonic() + self._rules.barrier_s
        while not self._is_cut() and self.ended() is None:
            if time.monotonic() >= until_s:
                where = self._topics.name_of(topic)
                raise AutonomyFault(
                    f"no longer subscribes to {where}, and has not ended either{self._printed()}"
                )
            time.sleep(_LOOK_S)
        self._has_left = True

    def _unanswered(self, topic: str, stamp_ns: int) -> str:
        newest = self._inbox.newest
        found = "it has published none" if newest is None else _stamp_text(newest.stamp_ns)
        where = self._topics.name_of(topic)
        return (
            f"gave no setpoint with the stamp {stamp_ns / _NS:.9f} of a message on {where} within "
            f"{self._rules.barrier_s:g} s of wall time (autonomy.ros2.barrier): {found}; copy "
            f"header.stamp of the message into the setpoint's{self._printed()}"
        )

    def _printed(self) -> str:
        """Return which node lives and does not do its part, and its last lines; "" for others.

        Where it raised in a callback, its process may go on without an end.
        """
        if self._node is None:
            return ""
        lines = self._node.last_lines()
        return f"; the node {self._node.name} printed last: {lines}" if lines else ""

    def _publish_latched(self, stamp_ns: int) -> None:
        mounts = partial(self._make.transforms, self._fixed(), stamp_ns)
        self._topics.publish(STATIC_TOPIC, stamp_ns, mounts)
        for topic in tuple(self._latched):
            build = partial(self._latched.__getitem__, topic)
            self._topics.publish(topic, stamp_ns, build)

    def _fixed(self) -> tuple[FrameTransform, ...]:
        return (FrameTransform(WORLD_FRAME, ODOMETRY_FRAME, (0.0, 0.0, 0.0)), *self._mounts)

    def _moving(self, pose: Pose) -> tuple[FrameTransform, ...]:
        position, turned = enu_from_ned(pose.position_ned_m), attitude_enu(pose.q_wxyz)
        body = FrameTransform(ODOMETRY_FRAME, BODY_FRAME, position, turned)
        gimbals = (sensor_frames(gimbal, pose) for gimbal in self._gimbals)
        return (body, *(frame for frames in gimbals for frame in frames))

    def _tick(self, t_s: float) -> int:
        """Publish the clock, which never goes back; return a time's stamp."""
        if t_s > self._clock_s:
            self._clock_s = t_s
            stamp_ns = self._stamp(t_s)
            self._topics.publish(CLOCK_TOPIC, stamp_ns, partial(self._make.clock, stamp_ns))
        return self._stamp(t_s)

    def _stamp(self, t_s: float) -> int:
        return self._epoch_ns + round(t_s * _NS)

    def _is_gone(self) -> bool:
        return self._is_cut() or (self._node is not None and self._node.has_ended)

    def _is_cut(self) -> bool:
        """Return whether the wire has ended, which decides the run and is no fault of the node."""
        trouble = self._topics.wire_trouble()
        if trouble:
            self._owes_answers = False
            self._decide_cut(trouble)
        return bool(trouble)

    def _limit(self, t_s: float) -> int | None:
        """Return which words are read by now; None for all, where nothing is answered."""
        is_held = self._owes_answers and t_s - self._answered_s < _HELD_S
        return self._until if is_held else None

    def _read_words(self, t_s: float) -> None:
        """Take what the node says beside its setpoints."""
        if (note := self._word(NOTE, t_s)) is not None:
            self._note = note
        if self._word(DONE, t_s) is not None:
            self._is_done, self._owes_answers = True, False
        self.hear_abort(t_s)

    def _word(self, topic: str, t_s: float) -> str | None:
        cdr = self._inbox.word(topic, self._limit(t_s))
        if cdr is None:
            return None
        try:
            text = str(self._types.deserialize(cdr, TEXT).data)
            return printable_problem(text)[:_LONGEST_WORD]
        except BadRosMessageError as error:
            raise AutonomyFault(f"published a message on {topic} that {error}") from None

    def _window(self, name: str, t_s: float) -> tuple[float, int, int]:
        return (t_s, *self._topics.counts(name))

    def _watch_needs(self, t_s: float) -> None:
        """Decide that the node is blind where under half of a topic's messages reached it."""
        for name, (began_s, offered, delivered) in tuple(self._windows.items()):
            if t_s - began_s < _BLIND_S:
                continue
            now = self._window(name, t_s)
            self._windows[name] = now
            published, left = now[1] - offered, now[2] - delivered
            if 2 * left < published:
                self._decide_blind(
                    f"{left} of {published} messages on {self._topics.name_of(name)} in "
                    f"{t_s - began_s:.1f} s found a subscriber"
                )

    def _receive_setpoint(self, telemetry: Telemetry) -> None:
        """Take the newest setpoint if it can be used; stop without one, and fail in the end."""
        for trouble in self._inbox.troubles():
            if "publishers" in trouble:
                raise AutonomyFault(f"is not alone: {trouble}")
        newest = self._answer if self._rules.barrier else self._inbox.newest
        if newest is not None and newest.number > self._used:
            self._used = newest.number
            if self._is_timely(newest, telemetry.t_s) and self._is_offboard(newest, telemetry.t_s):
                self._setpoint = self._setpoint_of(newest, telemetry.pose)
                self._fresh_s = telemetry.t_s
                newest.topic.used += 1
        since_s = telemetry.t_s - (telemetry.t_s if self._fresh_s is None else self._fresh_s)
        if since_s > self._rules.silent_s:
            why = [self._refused, *self._inbox.troubles()]
            because = "; ".join(text for text in why if text) or "it published none"
            raise AutonomyFault(
                f"published no setpoint that can be used for {since_s:.1f} s: {because}"
                f"{self._printed()}"
            )
        if since_s > _OLD_S:
            self._setpoint = _STILL

    def _is_timely(self, received: ReceivedSetpoint, t_s: float) -> bool:
        """Return whether a setpoint's stamp, if it has one, is about now."""
        if received.stamp_ns == 0 or self._rules.barrier:
            return True
        late_s = (self._stamp(t_s) - received.stamp_ns) / _NS
        if abs(late_s) <= _PAST_S:
            return True
        of_when = "old" if late_s > 0 else "ahead of /clock"
        self._refused = (
            f"the stamp of one on {received.topic.name} was {abs(late_s):.1f} s {of_when}"
        )
        received.topic.trouble = self._refused
        received.topic.refused += 1
        return False

    def _is_offboard(self, received: ReceivedSetpoint, t_s: float) -> bool:
        """Return whether PX4 would fly a setpoint in its mode; any that is none of px4_msgs."""
        if self._px4 is None or received.topic.type != TRAJECTORY_SETPOINT:
            return True
        trouble = self._px4.mode_trouble(t_s)
        if trouble:
            self._refused = received.topic.trouble = trouble
            received.topic.refused += 1
        return not trouble

    def _setpoint_of(self, received: ReceivedSetpoint, body: Pose) -> Setpoint:
        name, kind = received.topic.name, received.topic.type
        try:
            message = self._types.deserialize(received.cdr, kind)
            return setpoint_of(message, kind, body)
        except (BadRosMessageError, BadSetpointError) as error:
            what = printable_problem(str(error))[:_LONGEST_WORD]
            raise AutonomyFault(f"published a setpoint on {name} that {what}") from None


def _stamp_text(stamp_ns: int) -> str:
    return f"its newest has the stamp {stamp_ns / _NS:.9f}"
