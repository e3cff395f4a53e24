"""Opens the operator channels of a campaign, its socket and MQTT, while it flies."""

import json
import os
import secrets
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import replace
from pathlib import Path

from campaigns.setup.operator_setup import MqttSetup
from orchestrator.operator.broker_access import CAMPAIGN, BrokerAccess
from orchestrator.operator.campaign_controller import CampaignController
from orchestrator.operator.campaign_records import CampaignRecord, Place, places
from orchestrator.operator.errors import OperatingError
from safety.guard.operator.operator_socket import POINTER, OperatorSocket, write_private

TOKEN = "operator.token"  # noqa: S105 - a file's name
ACCESS = "operator.access.json"
"""The file in a results folder with address, topics and passwords of the campaign's broker."""


@asynccontextmanager
async def open_operator_channels(
    controller: CampaignController, mqtt: MqttSetup | None = None
) -> AsyncIterator[None]:
    """Open the campaign controller's operator channels: its socket, and MQTT.

    Registers the campaign as in flight on this machine. Raises OperatingError.
    """
    controller.guards = lambda: _guards(controller)
    async with AsyncExitStack() as stack:
        stack.callback(_close_log, controller)
        try:
            await _serve_socket(stack, controller)
        except OSError as error:
            raise OperatingError(f"the operator socket cannot be opened: {error}") from error
        if mqtt is not None:
            await _connect(stack, controller, mqtt)
        yield


def _close_log(controller: CampaignController) -> None:
    """Have a slow disk take the last lines of the operator log; say how many are lost."""
    if lost := controller.log.close():
        controller.warn(
            f"operator.jsonl: {lost} of its lines were not written, and with them commands that "
            f"operators gave; check the disk of {controller.folder}"
        )


async def _connect(stack: AsyncExitStack, controller: CampaignController, mqtt: MqttSetup) -> None:
    """Connect the campaign controller to its MQTT broker."""
    # Slow to import, and most campaigns have no broker.
    from orchestrator.operator.embedded_broker import embedded_broker  # noqa: PLC0415
    from orchestrator.operator.mqtt import MqttSecrets, mqtt_operating  # noqa: PLC0415

    token: str | None = None
    if mqtt.signed:
        token = _read_variable(mqtt.token_env, "token_env") or _make_token(controller.folder)
    else:
        controller.warn(
            f"operator.mqtt.commands is unsigned: any client that may publish at {mqtt.broker} can "
            "command this flight"
        )
    password = _read_variable(mqtt.password_env, "password_env")
    access: BrokerAccess | None = None
    if mqtt.broker.embedded:
        access = BrokerAccess.new(f"{mqtt.root}/{controller.campaign}")
        mqtt, password = replace(mqtt, user=CAMPAIGN), access.passwords[CAMPAIGN]
        await stack.enter_async_context(embedded_broker(mqtt.broker, access))
    _write_access(controller, mqtt, access)
    secrets_ = MqttSecrets(token=token, password=password)
    await stack.enter_async_context(mqtt_operating(mqtt, secrets_, controller))


def _write_access(
    controller: CampaignController, mqtt: MqttSetup, access: BrokerAccess | None
) -> None:
    """Write the broker's address and passwords, without the token, readable by the owner only."""
    passwords = {} if access is None else access.passwords
    access_document = {
        "host": mqtt.broker.host,
        "port": mqtt.broker.port,
        "tls": mqtt.broker.tls,
        "topics": f"{mqtt.root}/{controller.campaign}",
        "session": controller.session,
        "signed": mqtt.signed,
        "passwords": {user: passwords[user] for user in passwords if user != CAMPAIGN},
    }
    _write_secret(controller.folder / ACCESS, json.dumps(access_document, indent=2))


def _read_variable(name: str, key: str) -> str:
    """Return an environment variable with an operator's secret; empty where none is named."""
    if not name:
        return ""
    value = os.environ.get(name, "")
    if not value:
        raise OperatingError(f"operator.mqtt.{key}: the variable {name} is not set")
    return value


def _make_token(folder: Path) -> str:
    """Return a new operator token, stored in the campaign's folder for its owner alone."""
    token = secrets.token_urlsafe(24)
    _write_secret(folder / TOKEN, token)
    return token


def _write_secret(path: Path, text: str) -> None:
    """Write a file for its owner alone, in place of an earlier one. Raises OperatingError."""
    try:
        write_private(path, text + "\n")
    except OSError as error:
        raise OperatingError(f"{path.name} cannot be written: {error}") from error


async def _serve_socket(stack: AsyncExitStack, controller: CampaignController) -> None:
    """Serve the campaign controller's operator socket, and record it."""
    record = stack.enter_context(CampaignRecord(name=controller.campaign, folder=controller.folder))
    for text in record.passed_over:
        controller.warn(text)
    await stack.enter_async_context(
        OperatorSocket(
            path=record.socket,
            obey=controller.obey,
            status=controller.status,
            refused=controller.log.refused,
            pointer=controller.folder / POINTER,
        )
    )


def _guards(controller: CampaignController) -> Sequence[Place]:
    """Return the guards of the controlled campaign's runs."""
    try:
        return places().beneath(controller.folder).guards
    except OSError:
        # The runs get the abort by their pipes as well.
        return ()
