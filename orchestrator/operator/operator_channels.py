"""Opens the ways in which an operator reaches a campaign, for as long as it flies."""

import os
import secrets
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path

from campaigns.setup.operator_setup import MqttSetup
from orchestrator.operator.campaign_controller import CampaignController
from orchestrator.operator.campaign_records import CampaignRecord, Place, places
from orchestrator.operator.errors import OperatingError
from safety.guard.operator.operator_socket import POINTER, OperatorSocket

TOKEN = "operator.token"  # noqa: S105 - a file's name


@asynccontextmanager
async def open_operator_channels(
    controller: CampaignController, mqtt: MqttSetup | None = None
) -> AsyncIterator[None]:
    """Open the campaign controller's operator channels: its socket, and MQTT.

    Says on this machine that the campaign flies. Raises OperatingError.
    """
    controller.guards = lambda: _guards(controller)
    async with AsyncExitStack() as stack:
        try:
            await _serve_socket(stack, controller)
        except OSError as error:
            raise OperatingError(f"the operator socket cannot be opened: {error}") from error
        if mqtt is not None:
            await _connect(stack, controller, mqtt)
        yield


async def _connect(stack: AsyncExitStack, controller: CampaignController, mqtt: MqttSetup) -> None:
    """Connect the campaign controller to its MQTT broker."""
    # Slow to import, and most campaigns have no broker.
    from orchestrator.operator.embedded_broker import embedded_broker  # noqa: PLC0415
    from orchestrator.operator.mqtt import MqttSecrets, mqtt_operating  # noqa: PLC0415

    found = MqttSecrets(
        token=_variable(mqtt.token_env, "token_env") or _make_token(controller.folder),
        password=_variable(mqtt.password_env, "password_env"),
    )
    if mqtt.broker.embedded:
        await stack.enter_async_context(embedded_broker(mqtt.broker))
    await stack.enter_async_context(mqtt_operating(mqtt, found, controller))


def _variable(name: str, key: str) -> str:
    """Return an environment variable with an operator's secret; empty where none is named."""
    if not name:
        return ""
    value = os.environ.get(name, "")
    if not value:
        raise OperatingError(f"operator.mqtt.{key}: the variable {name} is not set")
    return value


def _make_token(folder: Path) -> str:
    """Return a new operator token, stored in the campaign's folder for its owner alone."""
    token = secrets.token_urlsafe(12)
    path = folder / TOKEN
    try:
        with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            file.write(token + "\n")
    except OSError as error:
        raise OperatingError(f"the token of operators cannot be written: {error}") from error
    return token


async def _serve_socket(stack: AsyncExitStack, controller: CampaignController) -> None:
    """Serve the campaign controller's operator socket, and record it."""
    record = stack.enter_context(CampaignRecord(name=controller.campaign, folder=controller.folder))
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
        # Without the folder of records the runs are told by their pipes still.
        return ()
