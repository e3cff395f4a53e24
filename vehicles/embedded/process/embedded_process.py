"""The process of one embedded vehicle, on the wall clock; `embedded_launch` is for its parent."""

import asyncio
import gc
import importlib
import os
import signal
import socket
import sys
from collections.abc import Callable, Sequence
from contextlib import AbstractAsyncContextManager, AsyncExitStack
from typing import Any, cast

from pydantic import ValidationError

from wil_campaign.foundation.clocks.paced_loop import PacedLoop
from wil_campaign.foundation.files.documents import BadInput
from wil_campaign.foundation.processes.clock_socket import InheritedClock
from wil_campaign.foundation.processes.codec import ProcessMessageError
from wil_campaign.foundation.processes.feed_socket import FeedSocket, inherited_feed
from wil_campaign.foundation.processes.linux import UnsupportedSystemError, die_with_parent
from wil_campaign.vehicles.embedded.emulations import load_kernels
from wil_campaign.vehicles.embedded.physics.config import ContactWorld
from wil_campaign.vehicles.embedded.process.feed import (
    FaultMessage,
    FromVehicle,
    MocapMessage,
    ToVehicle,
    TruthMessage,
    WorldEventMessage,
    from_vehicle,
    to_vehicle,
)
from wil_campaign.vehicles.embedded.process.process_settings import (
    ContactWorldSettings,
    ProcessSettings,
)
from wil_campaign.vehicles.embedded.process.vehicle_faults import VehicleFaults
from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle
from wil_campaign.vehicles.faults import FaultTextError, parse_fault
from wil_campaign.vehicles.links.link import LinkError
from wil_campaign.vehicles.links.link_factory import open_link
from wil_campaign.vehicles.links.link_strings import parse_link
from wil_campaign.vehicles.poses.truth import TruthSample
from wil_campaign.vehicles.readings import PoseReading
from wil_campaign.vehicles.readings.copies import restamp_pose

BAD_SETTINGS, FAILED = 2, 1
"""Exit codes; 0 after SIGTERM, SIGINT, a kill fault, or the end of stdin."""


Companion = Callable[[EmbeddedVehicle, VehicleFaults], AbstractAsyncContextManager[None]]
"""Opens a further part of the process while the vehicle flies, such as a camera."""


class FeedEnd(asyncio.DatagramProtocol):
    """The embedded process's end of its feed: an inherited socket, or UDP for other programs."""

    def __init__(self, *, vehicle: EmbeddedVehicle, faults: VehicleFaults) -> None:
        self._vehicle = vehicle
        self._faults = faults
        self._transport: asyncio.DatagramTransport | None = None
        self._inherited: FeedSocket | None = None
        self._seq = 0

    def inherit(self, end: socket.socket) -> None:
        """Use an inherited socket."""
        self._inherited = FeedSocket(end, self.receive)

    def close(self) -> None:
        """Close the feed's socket."""
        if self._inherited is not None:
            self._inherited.close()
        if self._transport is not None:
            self._transport.close()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the embedded process's feed socket (asyncio calls this)."""
        self._transport = cast("asyncio.DatagramTransport", transport)

    def datagram_received(self, data: bytes, addr: object) -> None:  # noqa: ARG002 - asyncio's
        """Handle a datagram: from the one address that the feed is sent to."""
        self.receive(data)

    def receive(self, data: bytes) -> None:
        """Handle an event or a fault; anything else is reported on stderr and dropped."""
        try:
            self._receive(to_vehicle.decode(data))
        except (ProcessMessageError, FaultTextError) as error:
            sys.stderr.write(f"feed: {error}\n")

    def error_received(self, exc: Exception) -> None:
        """Ignore the error: an absent parent does not end the embedded process."""

    def send_truth(self, sample: TruthSample) -> None:
        """Send a truth sample from the embedded process."""
        self._send(TruthMessage(self._seq, sample))

    def send_mocap(self, reading: PoseReading) -> None:
        """Send a motion capture reading from the embedded process."""
        self._send(MocapMessage(self._seq, reading))

    def _send(self, message: FromVehicle) -> None:
        self._seq += 1
        packet = from_vehicle.encode(message)
        if self._inherited is not None:
            self._inherited.send(packet)
        elif self._transport is not None and not self._transport.is_closing():
            self._transport.sendto(packet)

    def _receive(self, message: ToVehicle) -> None:
        """Handle a message to the embedded process: event or fault."""
        match message:
            case WorldEventMessage(_, name, t_s):
                self._vehicle.notify(name, t_s)
            case FaultMessage(_, fault):
                self._faults.inject(parse_fault(fault))


async def fly_embedded_vehicle(
    settings: ProcessSettings, stop: asyncio.Event, companions: Sequence[Companion] = ()
) -> None:
    """Run the embedded vehicle until `stop` is set. Raises LinkError, BadInput, or its error."""
    vehicle = EmbeddedVehicle(
        config=settings.config(),
        link=open_link(parse_link(settings.link)),
        seed=settings.seed,
        contact_world=_contact_world(settings.contact_world),
    )
    vehicle.on_fault(stop.set)
    if settings.print_texts:
        vehicle.on_sent(_print_text)
    faults = VehicleFaults(vehicle, kill=stop.set, report=_report_fault)
    feed = FeedEnd(vehicle=vehicle, faults=faults)
    inherited = inherited_feed()
    if inherited is not None:
        feed.inherit(inherited)
    elif settings.feed_port:
        await asyncio.get_running_loop().create_datagram_endpoint(
            lambda: feed, remote_addr=(settings.feed_host, settings.feed_port)
        )
    if inherited is not None or settings.feed_port:
        truth = faults.through("pose_source", _restamp_truth, feed.send_truth)
        vehicle.on_truth(truth, settings.truth_hz)
        vehicle.on_mocap(faults.through("pose_source", restamp_pose, feed.send_mocap))
    try:
        async with AsyncExitStack() as stack:
            await stack.enter_async_context(vehicle)
            for companion in companions:
                await stack.enter_async_context(companion(vehicle, faults))
            # All objects that exist now live as long as the process: the collector skips them.
            gc.freeze()
            gc.enable()
            for text in settings.faults:
                faults.inject(parse_fault(text))
            await stop.wait()
    finally:
        feed.close()


def main(arguments: list[str]) -> int:
    """Run the embedded process; the one argument is its settings as JSON. Return the exit code."""
    if len(arguments) != 1:
        sys.stderr.write("usage: python -m wil_campaign.vehicles.embedded SETTINGS_JSON\n")
        return BAD_SETTINGS
    try:
        settings = ProcessSettings.model_validate_json(arguments[0])
    except ValidationError as error:
        sys.stderr.write(f"{error}\n")
        return BAD_SETTINGS
    return run_process(settings)


def run_process(settings: ProcessSettings, companions: Sequence[Companion] = ()) -> int:
    """Run the process of an embedded vehicle until it ends; return the exit code.

    Raises what opening its companions raises.
    """
    try:
        if settings.end_with_parent:
            die_with_parent(signal.SIGTERM)
        load_kernels()
        with asyncio.Runner(loop_factory=lambda: PacedLoop(settings.speed)) as runner:
            runner.run(_await_stop(settings, companions))
    except (LinkError, BadInput, ValueError, UnsupportedSystemError) as error:
        sys.stderr.write(f"{error}\n")
        return FAILED
    return 0


async def _await_stop(settings: ProcessSettings, companions: Sequence[Companion]) -> None:
    """Run the embedded process's vehicle until SIGTERM, SIGINT or stdin's end."""
    loop, stop = asyncio.get_running_loop(), asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, stop.set)
    if settings.end_with_stdin:
        loop.add_reader(sys.stdin.fileno(), _on_stdin, stop.set)
    errors: list[BaseException] = []

    def failed(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Stop on a callback's error: a vehicle in an unknown state must not continue to fly."""
        error = context.get("exception")
        errors.append(error or RuntimeError(str(context.get("message"))))
        stop.set()

    loop.set_exception_handler(failed)
    clock = InheritedClock.of(loop, os.environ) if isinstance(loop, PacedLoop) else None
    try:
        await fly_embedded_vehicle(settings, stop, companions)
    finally:
        if clock is not None:
            clock.close()
    if errors:
        raise errors[0]


def _report_fault(text: str) -> None:
    """Print that a fault of an embedded vehicle has begun or ended."""
    sys.stderr.write(f"{text}\n")


def _restamp_truth(last: TruthSample, new: TruthSample) -> TruthSample:
    return last._replace(t_s=new.t_s)


def _print_text(boot_s: float, message: Any) -> None:
    """Print an embedded vehicle's STATUSTEXTs, and its acknowledgements of commands."""
    match message.get_type():
        case "STATUSTEXT":
            sys.stderr.write(f"{boot_s:9.3f} s STATUSTEXT {message.severity} {message.text}\n")
        case "COMMAND_ACK":
            answer = f"command {message.command} result {message.result}"
            sys.stderr.write(f"{boot_s:9.3f} s COMMAND_ACK {answer}\n")


def _on_stdin(stop: Callable[[], None]) -> None:
    if not os.read(sys.stdin.fileno(), 4096):
        asyncio.get_running_loop().remove_reader(sys.stdin.fileno())
        stop()


def _contact_world(settings: ContactWorldSettings | None) -> ContactWorld | None:
    """Return the embedded process's contact world. Raises ValueError when it is unavailable."""
    if settings is None:
        return None
    module, _, name = settings.use.partition(":")
    try:
        factory = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError) as error:
        raise ValueError(f"contact world {settings.use} cannot be loaded: {error}") from error
    return cast("ContactWorld", factory(settings.argument))
