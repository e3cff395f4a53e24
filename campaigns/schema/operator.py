"""`operator`: how people follow and command a campaign other than by its terminal: GCS, MQTT."""

import re
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from campaigns.values.broker_address import BrokerAddressError, parse_broker
from vehicles.links.link_strings import LinkAddressError, parse_link
from worlds.files.documents import KeyFaultError, Part


def _is_link(link: str) -> str:
    """Refuse an operator's ground station link of the wrong form."""
    try:
        address = parse_link(link)
    except LinkAddressError as error:
        raise ValueError(f"must be a link such as udpout://127.0.0.1:14550: {error}") from error
    if address.kind == "memory":
        raise ValueError(
            "memory:// connects to nothing; write udpout://, udpin://, tcpin:// or serial"
        )
    return link


def _is_broker(text: str) -> str:
    """Refuse the operator's MQTT broker address of the wrong form."""
    try:
        parse_broker(text)
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
GcsLink = Annotated[str, AfterValidator(_is_link)]


class GcsPart(Part):
    """The operator's `gcs`: links on which the guard relays a vehicle's MAVLink to a GCS.

    real, twin: the link to the ground station for that vehicle, such as udpout://127.0.0.1:14550;
    by default none.
    """

    real: GcsLink | None = None
    twin: GcsLink | None = None


class MqttPart(Part):
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
        tls = parse_broker(self.broker).tls
        for key in ("ca_file", "cert_file", "key_file"):
            if getattr(self, key) is not None and not tls:
                raise KeyFaultError(key, "is for TLS: write the broker as mqtts://")
        if self.commands == "unsigned" and self.token_env is not None:
            raise KeyFaultError("token_env", "has no effect with commands: unsigned; remove it")
        if self.key_file is not None and self.cert_file is None:
            raise KeyFaultError("key_file", "needs the cert_file that it belongs to")
        return self


class OperatorPart(Part):
    """The campaign's `operator`: ground stations, MQTT, and the action on operator loss.

    on_operator_loss: the action when the broker was unreachable for lost_after_s. gcs: ground
    stations that monitor and command the vehicles through the guard. mqtt: the broker for reports
    and commands; by default none. lost_after_s: how long the broker may be unreachable.
    """

    gcs: GcsPart = GcsPart()
    mqtt: MqttPart | None = None
    on_operator_loss: Literal["continue", "hold", "abort"] = "continue"
    lost_after_s: Annotated[float, Field(gt=0, le=3600)] = 10.0
