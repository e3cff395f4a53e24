"""Runs an embedded MQTT broker on loopback, for the users of one campaign."""

import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from wil_campaign.orchestrator.operator.errors import OperatingError
from wil_campaign.plugins.mqtt.broker_access import BrokerAccess
from wil_campaign.plugins.mqtt.broker_address import BrokerAddress

_PLUGINS = "wil_campaign.plugins.mqtt.broker_plugins"


@asynccontextmanager
async def embedded_broker(address: BrokerAddress, access: BrokerAccess) -> AsyncIterator[None]:
    """Run an MQTT broker at an address. Raises OperatingError when it cannot be started."""
    try:
        from amqtt.errors import BrokerError  # noqa: PLC0415 - slow, optional, rarely used

        from wil_campaign.plugins.mqtt.broker_plugins import ClosingBroker  # noqa: PLC0415
    except ImportError as error:
        raise OperatingError(
            "an embedded broker needs amqtt: pip install 'wil-campaign[broker]', or name a broker"
        ) from error
    # amqtt logs every client that disconnects without notice as an error.
    for name in ("amqtt", "transitions"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    users = {"base": access.base, "passwords": dict(access.passwords)}
    broker = ClosingBroker(
        {
            "listeners": {"default": {"type": "tcp", "bind": f"{address.host}:{address.port}"}},
            "plugins": {
                f"{_PLUGINS}.CampaignAuth": dict(users),
                f"{_PLUGINS}.CampaignTopics": dict(users),
            },
        }
    )
    try:
        await broker.start()
    except (OSError, BrokerError) as error:
        raise OperatingError(
            f"the embedded broker cannot use port {address.port}: {error}; end the program that "
            "uses it, or choose another: --broker embedded:1884"
        ) from error
    try:
        yield
    finally:
        await broker.shutdown()
