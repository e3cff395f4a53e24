"""Setup of the operators' MQTT broker, with its certificate files found."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from campaigns.schema.operator import MqttPart, OperatorPart
from campaigns.values.broker_address import BrokerAddress, parse_broker
from worlds.files.documents import Document, Problem
from worlds.files.paths import is_file

OnLoss = Literal["continue", "hold", "abort"]


@dataclass(frozen=True, slots=True, kw_only=True)
class MqttSetup:
    """How to reach the operator's MQTT broker, and what to publish there.

    user: empty for none. signed: whether commands have to be. password_env, token_env: names of
    environment variables; empty for none. ca_file: CA certificates that verify the broker; None
    for the system's. cert_file, key_file: our own certificate; None for none. root: of all topics.
    on_loss: the action when the broker was unreachable for lost_after_s.
    """

    broker: BrokerAddress
    user: str = ""
    password_env: str = ""
    token_env: str = ""
    signed: bool = True
    ca_file: Path | None = None
    cert_file: Path | None = None
    key_file: Path | None = None
    root: str = "wil"
    on_loss: OnLoss = "continue"
    lost_after_s: float = 10.0


def mqtt_setup(campaign: Document, part: OperatorPart, problems: list[Problem]) -> MqttSetup | None:
    """Return the operator's MQTT setup; None where none is given. Missing files are noted."""
    mqtt = part.mqtt
    if mqtt is None:
        return None
    broker = parse_broker(mqtt.broker)
    files = {
        key: _file(campaign, key, getattr(mqtt, key), problems)
        for key in ("ca_file", "cert_file", "key_file")
    }
    return MqttSetup(
        broker=broker,
        user=mqtt.user or broker.user,
        password_env=mqtt.password_env or "",
        token_env=mqtt.token_env or "",
        signed=mqtt.commands == "signed",
        root=mqtt.root,
        on_loss=part.on_operator_loss,
        lost_after_s=part.lost_after_s,
        **files,
    )


def _file(campaign: Document, key: str, name: str | None, problems: list[Problem]) -> Path | None:
    """Return the path of an operator's TLS or secret file; None, and a problem, if missing."""
    if name is None:
        return None
    path = (campaign.path.parent / name).resolve()
    if not is_file(path):
        message = f"there is no file '{name}' beside the campaign"
        problems.append(campaign.problem(("operator", "mqtt", key), message))
    return path


__all__ = ["MqttPart", "MqttSetup", "OnLoss", "mqtt_setup"]
