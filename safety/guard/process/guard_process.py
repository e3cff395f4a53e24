"""The guard in a process and session of its own, under the wall clock: started first, ended last.

`python -m wil_campaign.safety.guard.process CHANNEL LIFELINE HOLD` with three inherited file
descriptors: its end of the packet socket, the end of a pipe that becomes its children's stdin, and
the pipe's other end, which it only keeps open: the children's stdin ends when guard and
orchestrator are both gone.
A further argument, `scaled`, lets its clock follow that of a simulated vehicle; `server=END` is a
descriptor of the fork server that starts embedded vehicles.
"""

import asyncio
import contextlib
import gc
import logging
import os
import signal
import socket
import time
from collections.abc import Mapping
from contextlib import AsyncExitStack, ExitStack
from functools import partial
from pathlib import Path
from traceback import format_exception
from typing import Any

from wil_campaign.foundation.clocks.paced_loop import PacedLoop, call_wall_later, wall_timeout
from wil_campaign.foundation.clocks.quick_loop import quick_loop
from wil_campaign.foundation.processes.child import ChildProcess, exit_status_text
from wil_campaign.foundation.processes.clock_socket import clock_environment
from wil_campaign.foundation.processes.fork_server import ForkServer
from wil_campaign.foundation.processes.identity import ProcessId
from wil_campaign.foundation.processes.linux import lock_process_memory, raise_process_priority
from wil_campaign.foundation.tasks import FAULTS, TaskAccount, start_task
from wil_campaign.safety.guard.core.commands import (
    AnchorAt,
    BringDown,
    Command,
    NewFences,
    OperatorAction,
    OrchestratorAlive,
    OrchestratorEnded,
    StartOutage,
    VehicleGone,
)
from wil_campaign.safety.guard.core.events import EventKind, GuardEvent, unrecorded_event
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.safety.guard.local_guard import TICK_HZ, GuardLinks, LocalGuard
from wil_campaign.safety.guard.operator.operator_requests import OperatorOrders
from wil_campaign.safety.guard.operator.operator_socket import POINTER, OperatorSocket
from wil_campaign.safety.guard.process.channel import GuardChannel
from wil_campaign.safety.guard.process.channel_link import ChannelLink
from wil_campaign.safety.guard.process.guard_config import GuardConfig, GuardConfigError
from wil_campaign.safety.guard.process.guard_launch import SCALED, SERVER
from wil_campaign.safety.guard.process.guard_log import GuardLog, guard_file
from wil_campaign.safety.guard.process.guard_stderr import logging_in_thread
from wil_campaign.safety.guard.process.lockstep_clock import ORCHESTRATOR
from wil_campaign.safety.guard.process.messages import (
    ConfigMessage,
    EndGuard,
    EventMessage,
    FollowClock,
    FrameBytes,
    FrameSent,
    GuardFailed,
    GuardStatus,
    LinksOpened,
    OrchestratorReached,
    StartVehicle,
    ToGuard,
    VehicleEnded,
    VehiclePosition,
    VehicleStarted,
    to_guard,
)
from wil_campaign.safety.guard.process.orphaned_processes import (
    GuardRecord,
    reap_orphans,
    remove_guard_record,
    write_guard_record,
)
from wil_campaign.safety.guard.process.process_links import (
    guard_links,
    guard_vehicle_link,
    open_ports,
)
from wil_campaign.safety.guard.process.run_clock import RunClock
from wil_campaign.safety.guard.process.run_clock_factory import run_clock_of
from wil_campaign.safety.guard.process.runtime_folder import (
    open_runtime_folder,
    process_socket_path,
    runtime_folders,
    sweep_runtime_folder,
)
from wil_campaign.vehicles.errors import VehicleError
from wil_campaign.vehicles.links.link import Link
from wil_campaign.vehicles.mavlink.tlog import TlogWriter
from wil_campaign.vehicles.vehicle_server_process import vehicle_program

_log = logging.getLogger(__name__)

STATUS_S = 0.1
EARLY_S = 0.01
"""How much sooner a tick or a status may come, with a frame: the process wakes once for both."""
_CONFIG_S = 20.0
_LAST_POLL_S = 0.05
_LAST_TICKS_WALL_S = 5.0
GUARD_LOG = "guard.jsonl"


class GuardProcess:
    """The guard process: runs one guard from its config to the end of its last child."""

    def __init__(
        self,
        *,
        end: socket.socket,
        lifeline: int,
        scheduling: str = "normal",
        in_memory: bool = False,
        server: ForkServer | None = None,
    ) -> None:
        self._server = server
        self._scheduling = scheduling
        self._in_memory = in_memory
        self._channel = GuardChannel(
            end, receives=to_guard, take=self._take, closed=self._on_parent_death
        )
        self._lifeline = lifeline
        self._config_message: asyncio.Future[ConfigMessage | None]
        self._over = asyncio.Event()
        self._ending = False
        self._faults: list[BaseException] = []
        self._guarding = False
        self._is_orchestrator_lost = False
        self._statuses_unanswered = 0
        self._status_timer: asyncio.Handle | None = None
        self._status_at_s = 0.0
        self._children: dict[str, ChildProcess] = {}
        self._starts: set[asyncio.Task[None]] = set()
        self._names: tuple[str, ...] = ()
        self._links: list[ChannelLink] = []
        self._tlogs: dict[str, TlogWriter] = {}
        self._clock: RunClock | None = None
        self._log: GuardLog | None = None

    async def run(self) -> int:
        """Run the guard process until the orchestrator ends it, or is gone and all are down."""
        self._loop = loop = asyncio.get_running_loop()
        self._config_message = loop.create_future()
        loop.set_exception_handler(self._on_task_error)
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            loop.add_signal_handler(number, self._on_end_request, number)
        self._channel.open()
        async with asyncio.timeout(_CONFIG_S):
            message = await self._config_message
        if message is None:
            return 1
        account = TaskAccount(fault=self._fault, expected=(VehicleError, OSError))
        try:
            with account.of(loop):
                await self._serve(GuardConfig.unpacked(message.packed))
        except (GuardConfigError, VehicleError, OSError) as error:
            self._channel.send(GuardFailed(f"the guard cannot start: {error}"))
            return 1
        finally:
            self._channel.close()
        # Who waits for our end takes this for an error when nothing of it reached him.
        return 1 if self._faults else 0

    async def _serve(self, guard_config: GuardConfig) -> None:
        self._guard_config = guard_config
        self._names = tuple(guard_config.vehicles)
        folder = Path(guard_config.folder)
        self._log = guard_log = GuardLog(path=folder / GUARD_LOG)
        try:
            with ExitStack() as logs:
                for name in self._names:
                    log = TlogWriter(
                        path=folder / f"{name}.tlog",
                        epoch_s=guard_config.epoch_s,
                        open_file=guard_file,
                    )
                    self._tlogs[name] = log.__enter__()
                    logs.callback(self._close_tlog, name, log)
                async with AsyncExitStack() as stack:
                    await self._open(stack, guard_config)
                    try:
                        await self._over.wait()
                    except FAULTS as error:
                        # Nothing of ours ends a guard before all are down.
                        self._fault(error, "the guard")
                    await self._last()
                    self._guarding = False
        finally:
            pace = None if self._clock is None else self._clock.pace
            if pace is not None:
                self._note("paced", times_real_time=round(pace, 2))
            self._note("end", dropped=self._channel.dropped, garbage=self._channel.garbage)
            guard_log.close()

    async def _open(self, stack: AsyncExitStack, guard_config: GuardConfig) -> None:
        opened = open_runtime_folder()
        runtime = opened.path
        for text in opened.passed_over:
            self._note("runtime folder", text=f"{text}; {runtime} is used")
        for folder in runtime_folders():
            for text in await asyncio.to_thread(reap_orphans, folder):
                self._note("leftover", text=text)
        sweep_runtime_folder(runtime)
        raw = {name: guard_vehicle_link(vehicle) for name, vehicle in guard_config.vehicles.items()}
        self._clock = run_clock_of(
            guard_config,
            channel=self._channel,
            trouble=lambda trouble: self._guard.send(trouble),  # noqa: PLW0108 - it is made below
            took_over=lambda: self._guard.core.latched is not None,
        )
        if self._clock is not None:
            stack.callback(self._clock.close)
        links: dict[str, GuardLinks] = {}
        for index, (name, vehicle) in enumerate(guard_config.vehicles.items()):
            inner = ChannelLink(
                name=f"{name} orchestrator",
                index=index,
                channel=self._channel,
                target=vehicle.vehicle.target,
            )
            self._links.append(inner)
            near = raw[name] if self._clock is None else self._clock.tap(name, raw[name])
            links[name] = guard_links(
                vehicle, near, inner, report=partial(self._on_link, "link", name)
            )
        self._guard = LocalGuard(
            vehicles={name: vehicle.vehicle for name, vehicle in guard_config.vehicles.items()},
            links=links,
            settings=guard_config.settings,
            plan=guard_config.plan,
            record=self._record_frame,
            early_s=EARLY_S if self._clock is None else 0.0,
            ticked=self._send_due_status,
        )
        self._guard.on_event(self._event)
        await stack.enter_async_context(self._guard)
        self._guarding = True
        stack.push_async_callback(self._reap)
        await self._write_record(stack, runtime)
        self._report_opened(raw)

    async def _write_record(self, stack: AsyncExitStack, runtime: Path) -> None:
        """Open the operator's socket and write the guard process's record."""
        me = ProcessId.own()
        path = process_socket_path(runtime, "guard", me)
        path.unlink(missing_ok=True)
        orders = OperatorOrders(
            guard=self._guard,
            run=self._guard_config.run,
            refused=lambda text: self._note("refused", text=text),
            lost=lambda: self._is_orchestrator_lost,
        )
        await stack.enter_async_context(
            OperatorSocket(
                path=path,
                obey=orders.obey,
                status=orders.status,
                refused=lambda text: self._note("refused", text=text),
                token=self._guard_config.token,
                pointer=Path(self._guard_config.folder) / POINTER,
            )
        )
        self._runtime = runtime
        self._record = GuardRecord(
            run=self._guard_config.run,
            folder=self._guard_config.folder,
            campaign=self._guard_config.campaign,
            socket=str(path),
            guard=me,
            owner=ProcessId.of(os.getppid()),
            since_s=time.clock_gettime(time.CLOCK_BOOTTIME),
        )
        write_guard_record(runtime, self._record)
        stack.callback(remove_guard_record, runtime, me)

    def _report_opened(self, raw: Mapping[str, Link]) -> None:
        self._note(
            "opened", pid=os.getpid(), scheduling=self._scheduling, in_memory=self._in_memory
        )
        self._channel.send(LinksOpened(os.getpid(), open_ports(raw, report=self._on_link)))
        self._send_status()
        # What is loaded by now lives as long as the process: the collector need not look.
        gc.freeze()

    def _send_status(self) -> None:
        core = self._guard.core
        rest = not core.may_be_armed(self._loop.time())
        if core.latched is None and rest:
            # On the ground an orchestrator that is busy and silent does no harm.
            self._guard.send(OrchestratorAlive())
        self._statuses_unanswered += 1
        if rest and self._statuses_unanswered * STATUS_S > self._guard_config.patience_s:
            # Stopped, or in a debugger: its end of the channel is open, and may be so for ever.
            self._lose("nothing came from the orchestrator for a long time, and nothing flies")
        self._channel.send(
            GuardStatus(core.latched, core.all_down, rest, tuple(core.phases.values()))
        )
        # With a tick of the guard's, so that the process wakes once for both.
        now_s = time.monotonic()
        since_s = now_s - self._guard.started_s + EARLY_S
        delay_s = STATUS_S - since_s % STATUS_S + EARLY_S
        self._status_at_s = now_s + delay_s
        self._status_timer = call_wall_later(delay_s, self._send_status)

    def _send_due_status(self) -> None:
        if self._status_timer is not None and time.monotonic() >= self._status_at_s - EARLY_S:
            self._status_timer.cancel()
            self._send_status()

    def _take(self, message: ToGuard) -> None:
        self._statuses_unanswered = 0
        # By class, for those that nearly all are of: patterns touch more than these need.
        if isinstance(message, FrameBytes) and message.index < len(self._links):
            self._links[message.index].arrive(message.data, self._loop.time())
        elif isinstance(message, VehiclePosition) and message.index < len(self._links):
            name, place = self._names[message.index], message.position_ned_m
            self._guard.place(name, place, message.velocity_ned_m_s, message.t_s)
        elif isinstance(message, OrchestratorReached) and self._clock is not None:
            self._clock.reached(ORCHESTRATOR, message.run_s)
        elif isinstance(message, Command) and self._can_execute(message):
            self._guard.send(message)
        else:
            self._receive_rare(message)

    def _can_execute(self, command: Command) -> bool:
        """Return whether the guard is there, and the command is one for it and its vehicles."""
        match command:
            case OperatorAction(operators):
                is_ours = operators.kind != "geofence"
            case NewFences(_, fences):
                is_ours = fences.keys() <= {*self._names}
            case AnchorAt(vehicle) | StartOutage(vehicle):
                is_ours = vehicle in self._names
            case OrchestratorAlive() | BringDown():
                is_ours = True
        return is_ours and bool(self._links)

    def _receive_rare(self, message: ToGuard) -> None:
        match message:
            case ConfigMessage() if not self._config_message.done():
                self._config_message.set_result(message)
            case StartVehicle() if message.vehicle in self._names:
                task = start_task(self._start(message), name=f"start {message.vehicle}")
                self._starts.add(task)
                task.add_done_callback(self._starts.discard)
            case FollowClock() if self._clock is not None:
                self._clock.begin()
            case EndGuard():
                self._over.set()
            case _:
                self._note(
                    "refused", text=f"{type(message).__name__} is not expected in this state"
                )

    async def _start(self, start: StartVehicle) -> None:
        """Start a vehicle as a child of the guard process; its end is reported at once."""
        clock = None if self._clock is None else self._clock.inherit(start.vehicle)
        child = ChildProcess(
            argv=start.argv,
            stdin=self._lifeline,
            environment={**os.environ, **start.environment, **clock_environment(clock)},
            inherited=(*start.inherited, *(() if clock is None else (clock.fileno(),))),
        )
        try:
            await child.start_by(self._server, lambda one: self._child_ended(start.vehicle, one))
        except OSError as error:
            self._channel.send(VehicleEnded(start.vehicle, None, str(error)))
            return
        finally:
            if clock is not None:
                clock.close()
            for descriptor in start.inherited:
                with contextlib.suppress(OSError):
                    os.close(descriptor)
        self._children[start.vehicle] = child
        pid = child.pid or 0
        if child.identity is not None:
            self._record = self._record.with_child(child.identity)
            with contextlib.suppress(OSError):
                write_guard_record(self._runtime, self._record)
        self._note("started", vehicle=start.vehicle, pid=pid)
        self._channel.send(VehicleStarted(start.vehicle, pid))

    def _child_ended(self, name: str, child: ChildProcess) -> None:
        code = child.exit_code
        how = f"its process {exit_status_text(code)}"
        self._note("ended", vehicle=name, text=how)
        if not self._ending:
            self._guard.send(VehicleGone(name, f"{name} ended: {how}"))
        self._channel.send(VehicleEnded(name, code, child.stderr_tail))

    async def _reap(self) -> None:
        """End all children of the guard process, at the same time."""
        self._ending = True
        for task in tuple(self._starts):
            await asyncio.wait([task])
        children = tuple(self._children.values())
        ends = await asyncio.gather(*(child.end() for child in children), return_exceptions=True)
        for child, error in zip(children, ends, strict=True):
            if error is not None:
                child.kill()
                self._fault(error, "the end of a vehicle's process")

    async def _last(self) -> None:
        """Without an orchestrator: bring all down before the guard process ends."""
        loop = asyncio.get_running_loop()
        since_s = loop.time()
        self._guard.send(OrchestratorEnded())
        was_busy = False
        while busy := self._guard.core.may_be_armed(loop.time()):
            was_busy = True
            if loop.time() - since_s > self._guard_config.patience_s and not self._may_do_harm(
                busy
            ):
                self._note("given up", text=f"{', '.join(busy)} did not land")
                return
            await asyncio.sleep(_LAST_POLL_S)
        if was_busy:  # The tick that reports how they came down may be still to come.
            await await_last_ticks()

    def _may_do_harm(self, busy: tuple[str, ...]) -> bool:
        """Return whether anything was received lately from an armed vehicle that may do harm."""
        now_s, core = asyncio.get_running_loop().time(), self._guard.core
        return any(
            self._guard_config.vehicles[name].vehicle.attached
            and now_s - (core.last_received_s(name) or 0.0) < self._guard_config.patience_s
            for name in busy
        )

    def _on_parent_death(self) -> None:
        if not self._config_message.done():
            self._config_message.set_result(None)
        elif self._names:
            self._lose("the orchestrator's end of the pipe is closed")
        self._over.set()

    def _lose(self, text: str) -> None:
        if not self._is_orchestrator_lost:
            self._is_orchestrator_lost = True
            if self._clock is not None:
                self._clock.leave(ORCHESTRATOR)
            self._note("orphaned", text=text)
        self._over.set()

    def _on_end_request(self, number: signal.Signals) -> None:
        """Abort on SIGTERM, of an operator or a machine that shuts down; ignore SIGHUP, SIGINT."""
        self._note("signal", text=number.name)
        if number == signal.SIGTERM:
            if self._guarding:
                self._guard.send(OperatorAction(OperatorCommand("abort", number.name)))
            self._over.set()

    def _on_task_error(self, _: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Handle an exception in the guard process: it must not go on unnoticed."""
        error, where = context.get("exception"), str(context.get("message", ""))
        self._fault(error if isinstance(error, BaseException) else RuntimeError(where), where)

    def _fault(self, error: BaseException, where: str) -> None:
        if any(error is known for known in self._faults):
            return
        self._faults.append(error)
        kind = type(error).__name__
        now_s = asyncio.get_running_loop().time()
        event = GuardEvent(now_s, "guard", "", f"in the guard: {kind}: {error}")
        try:
            self._event(event)
            if self._guarding:
                self._guard.send(BringDown(event.text))
        finally:
            # Only now: the source of the lines of a traceback is read from the disk.
            trace = "".join(format_exception(error))
            _log.error(trace)
            self._note("error", where=where, type=kind, message=str(error), trace=trace)

    def _record_frame(self, name: str, t_s: float, frame: bytes) -> None:
        self._tlogs[name].write(t_s, frame)
        # COMMAND_INT, COMMAND_LONG of MAVLink 2: when they went out is the measure of a skew.
        if frame[7] in {75, 76} and frame[8] == 0 and frame[0] == 0xFD:
            self._channel.send(FrameSent(self._names.index(name), t_s, frame))

    def _close_tlog(self, name: str, log: TlogWriter) -> None:
        """Close a vehicle's tlog; report that its end cannot be written, unless that is known."""
        try:
            log.__exit__(None, None, None)
        except OSError as error:
            known = {event.vehicle for event in self._guard.events if event.kind == "record"}
            if name not in known:
                self._event(unrecorded_event(name, asyncio.get_running_loop().time(), error))

    def _event(self, event: GuardEvent) -> None:
        self._channel.send(EventMessage(event))
        details = {"kind": event.kind, "vehicle": event.vehicle, "text": event.text}
        if self._log is not None:
            self._log.write(event.t_s, "guard", **details)

    def _on_link(self, kind: EventKind, name: str, text: str) -> None:
        self._event(GuardEvent(asyncio.get_running_loop().time(), kind, name, text))

    def _note(self, event: str, **details: str | float | bool | None) -> None:
        if self._log is not None:
            self._log.write(asyncio.get_running_loop().time(), event, **details)


async def await_last_ticks(within_s: float = _LAST_TICKS_WALL_S) -> None:
    """Wait for two ticks of the run clock; within_s: in wall time at most, as it may stand still.

    The clock is that of a simulator, which may have ended with the flight.
    """
    with contextlib.suppress(TimeoutError):
        async with wall_timeout(within_s):
            await asyncio.sleep(2.0 / TICK_HZ)


def main(arguments: list[str]) -> int:
    """Run the guard process to its end; return the exit status."""
    channel, lifeline, hold = (int(argument) for argument in arguments[:3])
    os.set_inheritable(hold, False)
    end = socket.socket(fileno=channel)
    end.set_inheritable(False)
    factory = PacedLoop if SCALED in arguments[3:] else quick_loop
    with logging_in_thread(), asyncio.Runner(loop_factory=factory) as runner:
        guard = GuardProcess(
            end=end,
            lifeline=lifeline,
            scheduling=raise_process_priority(),
            in_memory=lock_process_memory(),
            server=_server(arguments[3:]),
        )
        return runner.run(guard.run())


def _server(words: list[str]) -> ForkServer | None:
    """Return the fork server of vehicles that a guard's further arguments name; None without."""
    for word in words:
        if word.startswith(SERVER):
            return ForkServer(int(word.removeprefix(SERVER)), vehicle_program())
    return None
