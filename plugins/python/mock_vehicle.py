"""An embedded vehicle as a process on a real MAVLink link, for tests and notebooks of users."""

import asyncio
import contextlib
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Literal, Self

from pydantic import ValidationError

from wil_campaign.foundation.files.documents import BadInput
from wil_campaign.foundation.processes.child import exit_status_text
from wil_campaign.foundation.processes.feed_socket import feed_environment, feed_pair
from wil_campaign.foundation.tasks import finish_in_task
from wil_campaign.plugins.python.several import as_several
from wil_campaign.plugins.python.standalone_settings import standalone_settings
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.embedded.process.feed import FaultMessage, to_vehicle
from wil_campaign.vehicles.embedded.process.process_settings import ProcessSettings
from wil_campaign.vehicles.faults import FaultTextError, InjectedFault, parse_fault
from wil_campaign.vehicles.links.link_strings import LinkAddress, parse_link

_OTHER_END: dict[str, Literal["udpin", "udpout", "tcpin", "tcpout"]] = {
    "udpout": "udpin",
    "udpin": "udpout",
    "tcpin": "tcpout",
    "tcpout": "tcpin",
}
_DEVICE = {"udpin": "udpin", "udpout": "udpout", "tcpin": "tcpin", "tcpout": "tcp"}
"""How pymavlink spells the kinds of links."""
_PORT_TAKEN = "is in use by another program"
_ATTEMPTS = 3
_END_WITHIN_S = 5.0
_POLL_S = 0.1
_PACKET_BYTES = 65536


class MockVehicleError(RuntimeError):
    """A mock vehicle cannot be started, or ended by itself; says why."""


class MockVehicle:
    """An embedded vehicle in a separate process; `with` and `async with` start and end it.

    url: where programs connect, as MAVSDK and campaign files write it; device: the same in the
    form of pymavlink, MAVProxy and dronekit. Both are known once it is started.
    """

    def __init__(
        self,
        autopilot: str,
        settings: ProcessSettings,
        *,
        port_is_free_choice: bool,
        faults: Iterable[InjectedFault],
        ready_within_s: float,
    ) -> None:
        self.autopilot = autopilot
        self._settings = settings
        self._chooses_port = port_is_free_choice
        self._faults = tuple(faults)
        self._ready_within_s = ready_within_s
        self._process: subprocess.Popen[bytes] | None = None
        self._stack = contextlib.ExitStack()
        self._feed: socket.socket | None = None
        self._is_ready = False
        self._seq = 0
        self._output_file: int | None = None
        self._output = ""

    @property
    def system_id(self) -> int:
        """Return the mock vehicle's MAVLink system id."""
        return self._settings.system_id

    @property
    def url(self) -> str:
        """Return where programs connect, as `udpin://127.0.0.1:14540`."""
        return str(_other_end(parse_link(self._settings.link)))

    @property
    def device(self) -> str:
        """Return where programs connect, as pymavlink writes it: `udpin:127.0.0.1:14540`."""
        address = _other_end(parse_link(self._settings.link))
        return f"{_DEVICE[address.kind]}:{address.host}:{address.port}"

    @property
    def pid(self) -> int | None:
        """Return the process id of the mock vehicle; None when it does not run."""
        process = self._process
        return None if process is None or process.poll() is not None else process.pid

    @property
    def output(self) -> str:
        """Return the output of the mock vehicle: its STATUSTEXTs, replies and errors."""
        if self._output_file is not None:
            size = os.fstat(self._output_file).st_size
            self._output = os.pread(self._output_file, size, 0).decode("utf-8", "replace")
        return self._output

    def fault(self, text: str) -> None:
        """Inject a fault: `kill`, `mute@5+2`, `motor 2 0.5`; docs/vehicle.md. Raises FaultError."""
        self._inject(_parse_fault(text))

    def start(self) -> None:
        """Start the mock vehicle and wait until its link is open. Raises MockVehicleError."""
        if self._process is not None:
            raise MockVehicleError(f"the mock {self.autopilot} is already started")
        for attempt in range(1, _ATTEMPTS + 1):
            if self._chooses_port:
                self._choose_port()
            try:
                self._launch()
            except MockVehicleError as error:
                if not (self._chooses_port and _PORT_TAKEN in str(error)) or attempt == _ATTEMPTS:
                    raise
            else:
                break
        for fault in self._faults:
            self._inject(fault)

    def stop(self) -> None:
        """End the mock vehicle. Raises MockVehicleError when it had ended with an error."""
        process = self._process
        if process is None:
            return
        code = process.poll()
        output = self._end()
        if code:
            raise MockVehicleError(
                f"the mock {self.autopilot} {exit_status_text(code)} while it was used:\n{output}"
            )

    def __enter__(self) -> Self:
        """Start the mock vehicle. Raises MockVehicleError."""
        self.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """End the mock vehicle; raise its error, unless another exception is being raised."""
        try:
            self.stop()
        except MockVehicleError:
            if kind is None:
                raise

    async def __aenter__(self) -> Self:
        """Start the mock vehicle while the event loop runs. Raises MockVehicleError."""
        try:
            await finish_in_task(
                asyncio.to_thread(self.start), name=f"start of a mock {self.autopilot}"
            )
        except asyncio.CancelledError:
            self._end()
            raise
        return self

    async def __aexit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """End the mock vehicle as `with` does."""
        self.__exit__(kind)

    def _choose_port(self) -> None:
        address = parse_link(self._settings.link)
        kind = socket.SOCK_DGRAM if address.kind.startswith("udp") else socket.SOCK_STREAM
        with socket.socket(socket.AF_INET, kind) as probe:
            probe.bind(("127.0.0.1", 0))
            port = int(probe.getsockname()[1])
        link = str(LinkAddress(address.kind, host="127.0.0.1", port=port))
        self._settings = self._settings.model_copy(update={"link": link})

    def _launch(self) -> None:
        """Start the process and wait for its first datagram. Raises MockVehicleError."""
        with contextlib.ExitStack() as stack:
            feed, theirs = map(stack.enter_context, feed_pair())
            feed.settimeout(_POLL_S)
            output = stack.enter_context(tempfile.TemporaryFile())  # removed when it is closed
            self._output_file = output.fileno()
            # It ends when its stdin does, however this process ends.
            self._process = subprocess.Popen(  # noqa: S603 - our own interpreter
                [
                    sys.executable,
                    "-P",
                    "-m",
                    "wil_campaign.vehicles.embedded",
                    self._settings.model_dump_json(),
                ],
                env={**os.environ, **feed_environment(theirs.fileno())},
                pass_fds=(theirs.fileno(),),
                stdin=subprocess.PIPE,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
            theirs.close()
            self._feed = feed
            self._stack = stack.pop_all()
        try:
            self._await_ready(self._process, feed)
        except BaseException:
            self._end()
            raise

    def _await_ready(self, process: subprocess.Popen[bytes], feed: socket.socket) -> None:
        """Wait for the ground truth that the vehicle sends once its link is open."""
        deadline_s = time.monotonic() + self._ready_within_s
        while time.monotonic() < deadline_s:
            with contextlib.suppress(TimeoutError):
                self._is_ready = bool(feed.recv(_PACKET_BYTES))
                if self._is_ready:
                    return
            if process.poll() is not None:
                how = exit_status_text(process.returncode)
                raise MockVehicleError(
                    f"the mock {self.autopilot} at {self._settings.link} did not start, it {how}:\n"
                    f"{self.output}"
                )
        raise MockVehicleError(
            f"the mock {self.autopilot} was not ready within {self._ready_within_s:g} s (the first "
            f"start after installation compiles; give a longer ready_within_s):\n{self.output}"
        )

    def _inject(self, fault: InjectedFault) -> None:
        """Send a fault to the process. Raises MockVehicleError if it does not run."""
        if self._feed is None or not self._is_ready or self.pid is None:
            raise MockVehicleError(
                f"the mock {self.autopilot} does not run: no fault can be injected"
            )
        self._seq += 1
        self._feed.send(to_vehicle.encode(FaultMessage(self._seq, str(fault))))

    def _end(self) -> str:
        """End the process, if necessary by SIGKILL, and return its output."""
        process, self._process, self._is_ready, self._feed = self._process, None, False, None
        if process is not None:
            if process.stdin is not None:
                process.stdin.close()
            process.terminate()
            try:
                process.wait(_END_WITHIN_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        output = self.output
        self._output_file = None
        self._stack.close()
        return output


def mock_vehicle(
    autopilot: str,
    *,
    link: str | None = None,
    profile: str = "nominal",
    world: str | Path | None = None,
    speed: float = 1.0,
    seed: int = 1,
    system_id: int = 1,
    running_s: float = 60.0,
    parameters: Mapping[str, float] | None = None,
    faults: Iterable[str] = (),
    ready_within_s: float = 120.0,
) -> MockVehicle:
    """Return an embedded PX4 or ArduCopter, to be started by `with` or `async with`.

    link: the vehicle's end; without one a free port of loopback, by UDP for px4 and by TCP for
    ardupilot, as the firmwares use. profile: a name, or a YAML file. world: a world file, for
    its origin and obstacles. speed: of its clock, in times real time. running_s: for how long it
    has been powered; ArduCopter needs 42 s until it can arm. faults: injected at its start; see
    `MockVehicle.fault`. ready_within_s: how long the start may take, wall clock.

    Raises BadInput for a faulty world or profile file, ValueError for any other wrong argument.
    """
    usual = parse_link(autopilot_named(autopilot).embedded_link)
    address = str(replace(usual, port=1)) if link is None else link
    _other_end(parse_link(address))
    try:
        settings = standalone_settings(
            autopilot,
            address,
            profile=profile,
            world=None if world is None else Path(world),
            speed=speed,
            seed=seed,
            system_id=system_id,
            running_s=running_s,
            parameters=parameters,
        )
    except ValidationError as error:
        faulty = (
            (str(error_details["loc"][0]), error_details["msg"]) for error_details in error.errors()
        )
        raise ValueError("; ".join(f"{name}: {text}" for name, text in faulty)) from None
    return MockVehicle(
        autopilot,
        settings.model_copy(update={"end_with_stdin": True, "print_texts": True}),
        port_is_free_choice=link is None,
        faults=[_parse_fault(text) for text in as_several(faults)],
        ready_within_s=ready_within_s,
    )


def _parse_fault(text: str) -> InjectedFault:
    fault = parse_fault(text)
    if fault.name == "camera":
        raise FaultTextError(f"{text!r}: a mock vehicle has no camera")
    return fault


def _other_end(address: LinkAddress) -> LinkAddress:
    """Return a program's end of a vehicle's link. Raises ValueError for no network link."""
    if address.kind not in _OTHER_END:
        raise ValueError(f"link {address}: a mock vehicle is at udp or tcp, as udpout://HOST:PORT")
    return LinkAddress(_OTHER_END[address.kind], host=address.host, port=address.port)


MOCK_ERRORS = (MockVehicleError, BadInput, ValueError)
"""The exceptions of starting a mock vehicle."""
