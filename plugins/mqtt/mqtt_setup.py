"""`operator.mqtt` of a campaign: its keys, and the setup of the broker that they name."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, model_validator

from wil_campaign.campaigns.schema.operator import ChannelPart, OnLoss, OperatorPart
from wil_campaign.foundation.files.documents import Document, KeyFaultError, Problem
from wil_campaign.foundation.files.paths import is_file
from wil_campaign.plugins.mqtt.broker_address import (
    BrokerAddress,
    BrokerAddressError,
    parse_broker_address,
)


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


def _is_broker(text: str) -> str:
    """Refuse the operator's MQTT broker address of the wrong form."""
    try:
        parse_broker_address(text)
    except BrokerAddressError as error:
        raise ValueError(str(error)) from error
    return text


def _is_variable(text: str) -> str:
    """Refuse a name that no environment variable can have."""
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]{0,127}", text):
        raise ValueError(f"'{text}' is not the name of an environment variable (like WIL_TOKEN)")
    return text


def _is_topic(text: str) -> str:
    """Refuse an MQTT topic prefix of the operator that is malformed."""
    if not re.fullmatch(r"[^/+#$\s][^+#\s]{0,199}(?<!/)", text):
        raise ValueError(f"'{text}' is not a topic prefix (like wil, or site/hall)")
    return text


Variable = Annotated[str, AfterValidator(_is_variable)]
"""The name of an environment variable: a campaign file contains no secrets."""
Topic = Annotated[str, AfterValidator(_is_topic)]


class MqttPart(ChannelPart):
    """The operator's `mqtt`: a broker for progress reports and operator commands.

    commands: whether they have to be signed. token_env: the environment variable that holds the
    token that signs commands; by default a token is made for each campaign, in its results folder.
    root: of all topics: <root>/<campaign>/status. broker: the broker's address, mqtt://HOST[:PORT]
    or mqtts:// for TLS. user: the name to log in with. password_env: the environment variable that
    holds the password. ca_file: CA certificates that verify the broker's certificate; by default
    the system's. cert_file: the certificate that this program presents to the broker. key_file: the
    private key of that certificate.
    """

    broker: Annotated[str, AfterValidator(_is_broker)]
    user: str | None = None
    password_env: Variable | None = None
    token_env: Variable | None = None
    commands: Literal["signed", "unsigned"] = "signed"
    ca_file: str | None = None
    cert_file: str | None = None
    key_file: str | None = None
    root: Topic = "wil"

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        """Require consistent TLS keys of the operator's MQTT broker."""
        tls = parse_broker_address(self.broker).tls
        for key in ("ca_file", "cert_file", "key_file"):
            if getattr(self, key) is not None and not tls:
                raise KeyFaultError(key, "is for TLS: write the broker as mqtts://")
        if self.commands == "unsigned" and self.token_env is not None:
            raise KeyFaultError("token_env", "has no effect with commands: unsigned; remove it")
        if self.key_file is not None and self.cert_file is None:
            raise KeyFaultError("key_file", "needs the cert_file that it belongs to")
        return self

    def setup(self, file: Document, operator: OperatorPart, problems: list[Problem]) -> MqttSetup:
        """Return the setup of the operators' broker; missing files are noted."""
        broker = parse_broker_address(self.broker)
        files = {
            key: _file(file, key, getattr(self, key), problems)
            for key in ("ca_file", "cert_file", "key_file")
        }
        return MqttSetup(
            broker=broker,
            user=self.user or broker.user,
            password_env=self.password_env or "",
            token_env=self.token_env or "",
            signed=self.commands == "signed",
            root=self.root,
            on_loss=operator.on_operator_loss,
            lost_after_s=operator.lost_after_s,
            **files,
        )

    @property
    def permits(self) -> Mapping[str, str]:
        """Return that commands need no signature, where that is so."""
        if self.commands == "signed":
            return {}
        return {
            "commands: unsigned": "commands by MQTT are not signed: every client that may publish "
            "at the broker can command the flight"
        }


def _file(file: Document, key: str, name: str | None, problems: list[Problem]) -> Path | None:
    """Return the path of an operator's TLS or secret file; None, and a problem, if missing."""
    if name is None:
        return None
    path = (file.path.parent / name).resolve()
    if not is_file(path):
        message = f"there is no file '{name}' beside the campaign"
        problems.append(file.problem(("operator", "mqtt", key), message))
    return path
