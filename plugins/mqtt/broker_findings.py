"""What `wil-campaign doctor` finds of MQTT brokers: on this machine, and of a campaign."""

import shutil
import socket
from collections.abc import Callable, Iterator
from importlib.util import find_spec

from wil_campaign.plugins.doctor.findings import CAMPAIGNS, Finding
from wil_campaign.plugins.mqtt.mqtt_setup import MqttSetup

_OPEN_S = 5.0
_BROKERS = "brokers"
_BROKER_PORT = 1883
Which = Callable[[str], str | None]


def broker_findings(file: object, setup: MqttSetup) -> Iterator[Finding]:
    """Yield the finding on a campaign's MQTT broker; none on one that the campaign starts."""
    broker = setup.broker
    if broker.embedded:
        return
    try:
        with socket.create_connection((broker.host, broker.port), timeout=_OPEN_S):
            pass
    except OSError as error:
        text = f"{file}: the broker {broker} does not answer: {error.strerror or error}"
        yield Finding(CAMPAIGNS, "trouble", text, "start it, or check its address and the network")
    else:
        yield Finding(CAMPAIGNS, "good", f"{file}: a program answers at the broker's {broker}")


def machine_findings(
    which: Which = shutil.which, port: int = _BROKER_PORT, module: str = "amqtt"
) -> Iterator[Finding]:
    """Yield findings on MQTT brokers that run here or are installed."""
    if _broker_answers(port):
        yield Finding(_BROKERS, "good", f"a program answers on tcp {port}, MQTT's port")
    elif which("mosquitto"):
        yield Finding(_BROKERS, "note", "mosquitto is installed but not running", "mosquitto -d")
    else:
        yield Finding(
            _BROKERS,
            "note",
            f"no broker answers on tcp {port}, and mosquitto is not on PATH",
            "for operators on other machines: apt install mosquitto",
        )
    if find_spec(module) is not None:
        yield Finding(_BROKERS, "good", f"{module}, a broker in Python, is installed")


def _broker_answers(port: int) -> bool:
    """Return whether a program accepts connections on a local port."""
    try:
        with socket.create_connection(("127.0.0.1", port), timeout=0.5):
            return True
    except OSError:
        return False
