"""A campaign's socket and its MQTT client, used once in each way, with an exception in them."""

import asyncio
import json
import os
import shutil
import tempfile
import time
from contextlib import AsyncExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest import mock

from tests.faults.exceptions.injection import (
    InjectingWallLoop,
    Injection,
    Point,
    Probe,
    protocols_pass_by,
)
from tests.orchestrator.operator.controllers import FakeFleet, make_controller
from tests.plugins.mqtt.test_mqtt_operator import ACCESS, SECRETS, Person
from tests.ports import free_port
from wil_campaign.foundation.tasks import TaskAccount
from wil_campaign.orchestrator.campaign.folder.campaign_folder import OutputError
from wil_campaign.orchestrator.operator.campaign_controller import CampaignController
from wil_campaign.orchestrator.operator.errors import OperatingError
from wil_campaign.orchestrator.operator.operator_channels import open_operator_channels
from wil_campaign.orchestrator.state.faults import InternalFault, InternalFaults, fault_log
from wil_campaign.plugins.mqtt.broker_address import BrokerAddress
from wil_campaign.plugins.mqtt.embedded_broker import embedded_broker
from wil_campaign.plugins.mqtt.mqtt_operator import connected_mqtt_operator
from wil_campaign.plugins.mqtt.mqtt_setup import MqttSetup
from wil_campaign.safety.guard.operator.operator_socket import POINTER

_PATIENCE_S = 10.0


@dataclass(slots=True)
class OperatorOutcome:
    """What came of it. logged: the errors in the campaign's log.jsonl."""

    counts: dict[Point, int] = field(default_factory=dict)
    happened: bool = False
    reported: list[str] = field(default_factory=list)
    logged: list[str] = field(default_factory=list)

    @property
    def faults(self) -> list[str]:
        """Return what must not be after an exception of ours."""
        if not self.happened:
            return []
        found = []
        if not any("injected at" in text for text in self.reported):
            found.append(f"the campaign is not told: {self.reported}")
        if not any("injected at" in text and "Traceback" in text for text in self.logged):
            found.append("no type, message and traceback in log.jsonl")
        return found


class OperatorFlights:
    """Operates again and again, in folders beneath `folder`."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def fly(self, injection: Injection | None = None) -> OperatorOutcome:
        """Operate, with an exception or undisturbed."""
        folder = Path(tempfile.mkdtemp(dir=self._folder))
        probe, outcome = Probe(injection), OperatorOutcome()
        with (
            mock.patch.dict(os.environ, {"XDG_RUNTIME_DIR": str(folder)}),
            protocols_pass_by(probe),
            asyncio.Runner(loop_factory=lambda: InjectingWallLoop(probe)) as runner,
        ):
            runner.run(_operate(folder, outcome, probe))
        outcome.counts, outcome.happened = probe.counts, probe.raised
        log = folder / "log.jsonl"
        lines = log.read_text().splitlines() if log.exists() else []
        entries = [json.loads(line) for line in lines]
        outcome.logged = [
            f"{entry['type']}: {entry['message']}\n{entry['trace']}" for entry in entries
        ]
        shutil.rmtree(folder)
        return outcome


async def _operate(folder: Path, outcome: OperatorOutcome, probe: Probe) -> None:
    """Account for the loop as a campaign does."""
    loop = asyncio.get_running_loop()
    limit = asyncio.timeout(6 * _PATIENCE_S)

    def report(fault: InternalFault) -> None:
        outcome.reported.append(f"{fault.text}\n{fault.trace}")
        # Who waits for what a task that died was to say waits in vain.
        with suppress(RuntimeError):  # it is over
            limit.reschedule(loop.time() + _PATIENCE_S / 5)

    faults = InternalFaults(time=time.monotonic, log=fault_log(folder / "log.jsonl"), take=report)

    def unhandled(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        error = context.get("exception")
        faults.record(
            error if isinstance(error, BaseException) else RuntimeError(str(context)), "?"
        )

    loop.set_exception_handler(unhandled)
    account = TaskAccount(fault=faults.record, expected=(OutputError, OperatingError, OSError))
    controller = make_controller(folder, FakeFleet())
    with account.of(loop):
        try:
            async with limit, open_operator_channels(controller):
                probe.stage = lambda: "flying"
                await _use_socket(folder)
                await _use_broker(controller)
        except BaseException as error:  # noqa: BLE001 - whatever it is, the campaign is told
            faults.record(error, "the campaign")


async def _use_socket(folder: Path) -> None:
    path = json.loads((folder / POINTER).read_text())["socket"]
    reader, writer = await asyncio.open_unix_connection(path)
    try:
        for line in (b'{"command": "status", "who": "anna"}', b"nothing", b'{"command": "watch"}'):
            writer.write(line + b"\n")
            await _line(reader)
        await _line(reader)
    finally:
        writer.close()


async def _line(reader: asyncio.StreamReader) -> None:
    async with asyncio.timeout(_PATIENCE_S):
        await reader.readline()


async def _use_broker(controller: CampaignController) -> None:
    """Give a command by a broker, lose the broker, and have it again."""
    address = BrokerAddress("127.0.0.1", free_port(), embedded=True)
    setup = MqttSetup(broker=address, user="wil")
    async with AsyncExitStack() as stack:
        broker = await stack.enter_async_context(AsyncExitStack())
        await broker.enter_async_context(embedded_broker(address, ACCESS))
        await stack.enter_async_context(connected_mqtt_operator(setup, SECRETS, controller))
        async with Person(address.port, controller) as person:
            await person.command("hold")
            await person.say("abort", b"{")
            await person.until("operator/ack", 2)
        await broker.aclose()
        await asyncio.sleep(0.2)
        await broker.enter_async_context(embedded_broker(address, ACCESS))
        async with Person(address.port, controller) as person:
            await person.until("status", 1)
