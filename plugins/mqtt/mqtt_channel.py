"""Opens the channel of operators by MQTT: the token, the broker where it is ours, the client."""

import json
import os
import secrets
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import replace
from pathlib import Path

from wil_campaign.orchestrator.operator.campaign_controller import CampaignController
from wil_campaign.orchestrator.operator.errors import OperatingError
from wil_campaign.plugins.mqtt.broker_access import CAMPAIGN, BrokerAccess
from wil_campaign.plugins.mqtt.embedded_broker import embedded_broker
from wil_campaign.plugins.mqtt.mqtt_operator import MqttSecrets, connected_mqtt_operator
from wil_campaign.plugins.mqtt.mqtt_setup import MqttSetup
from wil_campaign.safety.guard.operator.operator_socket import write_private

TOKEN = "operator.token"  # noqa: S105 - a file's name
ACCESS = "operator.access.json"
"""The file in a results folder with address, topics and passwords of the campaign's broker."""


@asynccontextmanager
async def open_mqtt(controller: CampaignController, mqtt: MqttSetup) -> AsyncIterator[None]:
    """Connect a campaign controller to its MQTT broker. Raises OperatingError."""
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
    async with AsyncExitStack() as stack:
        if mqtt.broker.embedded:
            access = BrokerAccess.new(f"{mqtt.root}/{controller.campaign}")
            mqtt, password = replace(mqtt, user=CAMPAIGN), access.passwords[CAMPAIGN]
            await stack.enter_async_context(embedded_broker(mqtt.broker, access))
        _write_access(controller, mqtt, access)
        secrets_ = MqttSecrets(token=token, password=password)
        await stack.enter_async_context(connected_mqtt_operator(mqtt, secrets_, controller))
        yield


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
