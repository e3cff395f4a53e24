"""Opens the node of a vehicle for a run: its domain, its wire, its process, until it is ready."""

import asyncio
import json
import os
import threading
import time
from collections.abc import AsyncIterator, Iterable, Mapping
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal, cast

from wil_campaign.foundation.clocks.sleeping import sleep_until
from wil_campaign.foundation.tasks import start_task, stop_tasks
from wil_campaign.orchestrator.recording.timestamps import VIRTUAL_EPOCH_S
from wil_campaign.orchestrator.run.perception.autonomy_calls import AutonomyFault
from wil_campaign.orchestrator.run.perception.stray_errors import decide_fault
from wil_campaign.orchestrator.run.vehicles.pair import VehiclePair
from wil_campaign.orchestrator.run_results.result_parts import ProgramResult, TopicResult
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.plugins.ros2.domains import claimed_domain
from wil_campaign.plugins.ros2.messages.reading_messages import ros_word_of_name
from wil_campaign.plugins.ros2.messages.ros_types import RosTypes, ros_types
from wil_campaign.plugins.ros2.messages.topics import (
    GOAL,
    OWN,
    SETPOINTS,
    STAGE,
    VERDICT,
    WORDS,
    OutTopic,
    sensor_topics,
)
from wil_campaign.plugins.ros2.node_autonomy import NodeAutonomy, NodeRules
from wil_campaign.plugins.ros2.node_process import NodeProcess, started_node
from wil_campaign.plugins.ros2.node_topics import NodeTopics
from wil_campaign.plugins.ros2.px4.px4_types import (
    PX4_OUT,
    PX4_SETPOINTS,
    PX4_WORDS,
    px4_names,
    px4_types,
)
from wil_campaign.plugins.ros2.px4.px4_vehicle import Px4Vehicle
from wil_campaign.plugins.ros2.rclpy_wire import open_rclpy
from wil_campaign.plugins.ros2.ros2_autonomy import Ros2Autonomy
from wil_campaign.plugins.ros2.ros2_part import Ros2Part
from wil_campaign.plugins.ros2.setpoint_inbox import InTopic, SetpointInbox
from wil_campaign.plugins.ros2.wire import NodeWire, WireError
from wil_campaign.safety.model.verdict import DecisiveKind

_ROUTER_PORT = 7447
"""Where nodes of rmw_zenoh look for their router."""
_LOOK_S = 0.02
_SETTLED_S = 0.3
"""How long no subscription may have been added, for a node to be ready."""
_BEYOND_SENSORS = frozenset(out_topic.name for out_topic in OWN) - {"/odom", "/pose"}
"""Topics whose subscription does not tell that a node has come: every node has some."""


@dataclass(slots=True)
class OpenNode:
    """A node that is open for a run: the autonomy, and what its result says."""

    autonomy: NodeAutonomy
    vehicle: str
    topics: NodeTopics
    inbox: SetpointInbox
    node: NodeProcess | None

    @property
    def result(self) -> ProgramResult:
        """Return how the node ended, and the counts of its topics."""
        return ProgramResult(
            vehicle=self.vehicle,
            exit="was found, and goes on" if self.node is None else _exit_text(self.node),
            refused=sum(topic.refused for topic in self.inbox.topics.values()),
            trouble="; ".join(self.inbox.troubles()),
            topics=(*self.topics.results(), *_in_results(self.inbox)),
        )


@dataclass(frozen=True, slots=True)
class FlownVehicle:
    """A vehicle for which a node is opened, in its run."""

    setup: RunSetup
    context: VehicleContext
    run_state: RunState


@asynccontextmanager
async def open_node(
    setup: RunSetup, _pair: VehiclePair, context: VehicleContext, run_state: RunState
) -> AsyncIterator[OpenNode]:
    """Open a vehicle's node and wait until it is ready; it is ended on leaving.

    Raises AutonomyFault for a node that ends or that cannot fly, WireError.
    """
    part = cast("Ros2Autonomy", setup.case.under_test.foreign).part
    vehicle = FlownVehicle(setup, context, run_state)
    loop = asyncio.get_running_loop()
    async with AsyncExitStack() as stack:
        types = await loop.run_in_executor(None, _types, part, setup.case.under_test.folder)
        domain = stack.enter_context(claimed_domain(part.domain))
        wire = await stack.enter_async_context(_open_wire(part, vehicle, domain, types))
        flight = _NodeFlight(part, vehicle, wire, types)
        node = None
        if part.argv:
            environment = flight.environment(domain)
            node = await stack.enter_async_context(flight.started(environment))
        found = flight.build(node)
        await flight.wait_ready(found)
        telemetry = start_task(flight.report(found.autonomy), name="telemetry to the node")
        stack.push_async_callback(stop_tasks, telemetry)
        yield found


def _types(part: Ros2Part, folder: Path) -> RosTypes:
    """Return the types of a node's messages. folder: of the campaign. Raises KeyFaultError."""
    if part.px4_msgs is None:
        return ros_types(part.distribution)
    return px4_types(part.distribution, folder / part.px4_msgs)


@asynccontextmanager
async def _open_wire(
    part: Ros2Part, vehicle: FlownVehicle, domain: int, types: RosTypes
) -> AsyncIterator[NodeWire]:
    """Open the wire that a campaign asks for. Raises WireError."""
    setup = vehicle.setup
    if part.wire == "rclpy":
        log = setup.order.folder / f"{vehicle.context.name}-relay.log"
        folder = setup.case.under_test.folder
        async with open_rclpy(part.python, domain=domain, folder=folder, log=log) as relayed:
            yield relayed
        return
    from wil_campaign.plugins.ros2.zenoh_wire import ZenohWire  # noqa: PLC0415 - of an extra

    port = _ROUTER_PORT if part.found else 0
    opening = partial(ZenohWire, domain=domain, port=port, types=types)
    wire = await asyncio.get_running_loop().run_in_executor(None, opening)
    try:
        yield wire
    finally:
        wire.close()


class _NodeFlight:
    """The flight of one vehicle by a node."""

    def __init__(
        self, part: Ros2Part, vehicle: FlownVehicle, wire: NodeWire, types: RosTypes
    ) -> None:
        self._part, self._wire, self._types = part, wire, types
        self._setup, self._context = vehicle.setup, vehicle.context
        self._run_state, self._name = vehicle.run_state, vehicle.context.name
        self._loop = asyncio.get_running_loop()
        self._decided: set[str] = set()
        sensors = self._setup.vehicle(self._name).sensors
        names = part.topics if part.px4_msgs is None else {**px4_names(types), **part.topics}
        self._topics = NodeTopics(wire, _out_topics(part, vehicle), names)
        self._inbox = SetpointInbox(setpoint_topics(part, names))
        self._sensors = sensors
        for name, topic in self._inbox.topics.items():
            wire.listen(name, topic.type, self._inbox.receive)
        self._node: NodeProcess | None = None
        self._autonomy: NodeAutonomy | None = None
        self._is_ready = False

    def environment(self, domain: int) -> dict[str, str]:
        under_test = self._setup.case.under_test
        return {
            "PYTHONUNBUFFERED": "1",
            **os.environ,
            **self._wire.environment(),
            "ROS_DOMAIN_ID": str(domain),
            "WIL_GOAL": json.dumps(dict(under_test.goal), allow_nan=False),
            "WIL_PARAMETERS": json.dumps(dict(under_test.parameters), allow_nan=False),
            "WIL_VEHICLE": self._name,
            "WIL_SEED": str(self._setup.seed),
        }

    @asynccontextmanager
    async def started(self, environment: Mapping[str, str]) -> AsyncIterator[NodeProcess]:
        async with started_node(
            self._part.argv,
            environment=environment,
            folder=self._setup.case.under_test.folder,
            log=self._setup.order.folder / f"{self._name}-node.log",
            on_end=self._on_node_end,
        ) as node:
            self._node = node
            yield node

    def build(self, node: NodeProcess | None) -> OpenNode:
        """Return the open node, of which nothing has come yet. Raises WireError."""
        is_virtual = self._setup.clock == "virtual"
        px4 = None if self._part.px4_msgs is None else Px4Vehicle(self._types)
        autonomy = NodeAutonomy(
            topics=self._topics,
            inbox=self._inbox,
            types=self._types,
            node=node,
            sensors=self._sensors,
            epoch_s=VIRTUAL_EPOCH_S if is_virtual else time.time() - self._loop.time(),
            rules=self._rules(),
            decide_blind=partial(self._decide_once, "INVALID", "was blind: "),
            decide_cut=partial(self._decide_once, "ERROR", "cannot be reached: "),
            abort=partial(self._decide_once, "ABORTED", "asked for an abort: "),
            px4=px4,
        )
        self._autonomy = autonomy
        if px4 is not None:
            self._run_state.on_stage(lambda stage, _: px4.enter(stage))
        autonomy.latch(GOAL, json.dumps(dict(self._setup.case.under_test.goal)))
        self._run_state.on_stage(lambda stage, _: autonomy.latch(STAGE, stage))
        self._run_state.on_decisive(
            lambda event: autonomy.latch(VERDICT, f"{event.kind}: {event.text}")
        )
        return OpenNode(autonomy, self._name, self._topics, self._inbox, node)

    async def wait_ready(self, found: OpenNode) -> None:
        """Wait until the node subscribes to what it needs. Raises AutonomyFault, WireError."""
        needs = self._named("needs", self._part.needs)
        waited = needs | self._rules().barrier
        begun = partial(self._wait_subscribed, found, waited)
        await self._loop.run_in_executor(None, begun)
        if troubles := self._inbox.troubles():
            raise self._fault(f"cannot fly: {'; '.join(troubles)}", "ERROR")
        self._is_ready = True
        subscribed = self._topics.subscribed() & self._topics.sensor_topics()
        found.autonomy.need(sorted(needs or subscribed))

    async def report(self, autonomy: NodeAutonomy) -> None:
        """Publish the telemetry while `act` does not, until cancelled."""
        period_s = 1.0 / self._setup.case.under_test.rate_hz
        t0_s, tick = self._loop.time(), 0
        while True:
            tick = max(tick + 1, int((self._loop.time() - t0_s) / period_s))
            await sleep_until(t0_s + tick * period_s)
            telemetry = self._context.telemetry()
            try:
                autonomy.hear_abort(self._loop.time())
                if telemetry is None or telemetry.t_s < autonomy.acted_s + 1.9 * period_s:
                    continue
                publish = partial(autonomy.report, telemetry, is_answered=not autonomy.flying)
                if self._setup.clock == "wall":
                    await self._loop.run_in_executor(None, publish)
                else:
                    publish()  # in the order of the readings
            except AutonomyFault as fault:
                decide_fault(self._run_state, self._name, fault)
                return

    def _rules(self) -> NodeRules:
        """Return what is asked of the node on this run's clock. Raises WireError."""
        part, barrier = self._part, self._part.barrier
        rules = NodeRules(silent_s=part.silent_s, compressed=part.compressed)
        if barrier is None or self._setup.clock == "wall":
            return rules
        named = self._named("barrier.topics", barrier.topics)
        return replace(rules, barrier=named, barrier_s=barrier.timeout_s)

    def _named(self, key: str, names: Iterable[str]) -> frozenset[str]:
        """Return topics by our names. Raises WireError for one that is not published."""
        found = {name: self._topics.published(name) for name in names}
        if missing := [name for name, ours in found.items() if not ours]:
            there = ", ".join(sorted(self._topics.names()))
            message = f"autonomy.ros2.{key}: nothing is published on {', '.join(missing)}"
            raise WireError(f"{message} (there are {there})")
        return frozenset(found.values())

    def _wait_subscribed(self, found: OpenNode, waited: frozenset[str]) -> None:
        """Wait, in a thread, until the node subscribes. Raises AutonomyFault."""
        until_s = time.monotonic() + self._part.start_s
        subscribed, since_s = self._topics.subscribed(), time.monotonic()
        while True:
            if self._node is not None and self._node.has_ended:
                lines = self._node.last_lines()
                message = f"is a node that {self._node} before it was ready: {lines}"
                raise self._fault(message, "ERROR")
            if trouble := self._wire.trouble():
                raise WireError(trouble)
            now, now_s = self._topics.subscribed(), time.monotonic()
            if now != subscribed:
                subscribed, since_s = now, now_s
            is_here = waited <= subscribed if waited else bool(subscribed - _BEYOND_SENSORS)
            if is_here and now_s - since_s >= _SETTLED_S:
                return
            if now_s >= until_s:
                raise self._fault(self._absence(found, waited - subscribed), "ERROR")
            time.sleep(_LOOK_S)

    def _fault(self, text: str, kind: Literal["FAIL", "ERROR"] = "FAIL") -> AutonomyFault:
        """Return a fault before the takeoff, in a whole sentence."""
        return AutonomyFault(f"the autonomy of {self._name} {text}", kind=kind)

    def _absence(self, found: OpenNode, missing: frozenset[str]) -> str:
        wanted = missing or self._topics.names() - _BEYOND_SENSORS
        names = ", ".join(sorted(self._topics.name_of(name) for name in wanted))
        which = "" if missing else "any of "
        lines = "" if found.node is None else found.node.last_lines()
        printed = f"; its last lines: {lines}" if lines else ""
        mismatches = "; ".join(self._wire.mismatches())
        remedy = "check its RMW_IMPLEMENTATION, and its topics by autonomy.ros2.topics"
        return (
            f"is a node that has not subscribed to {which}{names} within {self._part.start_s:g} s "
            f"(autonomy.ros2.start_s): {mismatches or remedy}{printed}"
        )

    def _on_node_end(self) -> None:
        """Decide the run where the node crashed, or ended before its goal (in the loop)."""
        node, state = self._node, self._run_state
        is_done = node is not None and node.exit_code == 0 and state.reached("goal")
        if node is None or is_done or not self._is_ready:
            return
        # From its goal on it is a FAIL (`decide_fault`).
        fault = AutonomyFault(f"is a node that {node.ending}", kind="ERROR")
        try:
            if self._autonomy is not None:
                self._autonomy.hear_abort()
        except AutonomyFault as unreadable:
            fault = unreadable
        decide_fault(state, self._name, fault)

    def _decide_once(self, kind: DecisiveKind, prefix: str, text: str) -> None:
        """Decide the run, once of a kind; in any thread."""
        if kind in self._decided:
            return
        self._decided.add(kind)
        reason = f"the autonomy of {self._name} {prefix}{text}"
        decide = partial(self._run_state.decide, kind, reason, source=f"ros2/{self._name}")
        if threading.current_thread() is threading.main_thread():
            decide()
        else:
            self._loop.call_soon_threadsafe(decide)


def _out_topics(part: Ros2Part, vehicle: FlownVehicle) -> tuple[OutTopic, ...]:
    setup, name = vehicle.setup, vehicle.context.name
    found = [*OWN, *(PX4_OUT if part.px4_msgs is not None else ())]
    for sensor in setup.vehicle(name).sensors:
        word = ros_word_of_name(sensor.name)
        found += sensor_topics(word, sensor.kind, compressed=part.compressed)
    recipe = setup.case.recipe if setup.mode == "wil" else None
    for combination in () if recipe is None else recipe.combinations:
        if combination.publish_raw and name in combination.publish:
            for side in ("real", "twin"):
                path = f"{side}/{ros_word_of_name(combination.sensor.name)}"
                found += sensor_topics(path, combination.sensor.kind, compressed=part.compressed)
    return tuple(found)


def setpoint_topics(part: Ros2Part, names: Mapping[str, str | None]) -> dict[str, InTopic]:
    """Return the topics of setpoints and words by the node's names. names: of ours, by ours."""
    ours = {**SETPOINTS, **WORDS}
    if part.px4_msgs is not None:
        ours |= {**PX4_SETPOINTS, **PX4_WORDS}
    named = ((names.get(name, name), name, kind) for name, kind in ours.items())
    return {to: InTopic(name, kind) for to, name, kind in named if to is not None}


def _exit_text(node: NodeProcess) -> str:
    """Return how a node ended, with its last lines where it failed."""
    is_failed = not node.ended_by_us and node.exit_code != 0
    return node.ending if is_failed else str(node)


def _in_results(inbox: SetpointInbox) -> tuple[TopicResult, ...]:
    return tuple(
        TopicResult(name, topic.type, "in", topic.received, topic.used, topic.trouble)
        for name, topic in inbox.topics.items()
        if topic.received
    )
