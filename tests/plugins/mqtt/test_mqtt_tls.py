"""A desk at mosquitto with TLS, certificates, a password and an ACL: who gets in."""

import asyncio
import subprocess
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from tests.orchestrator.operator.controllers import FakeFleet, make_controller
from tests.plugins.mqtt.mosquitto import (
    PASSWORD,
    UNNAMED,
    USER,
    make_certificates,
    mosquitto,
    needs_mosquitto,
)
from tests.ports import free_port
from wil_campaign.orchestrator.operator.errors import OperatingError
from wil_campaign.plugins.mqtt.broker_address import BrokerAddress
from wil_campaign.plugins.mqtt.message_signing import signed_command
from wil_campaign.plugins.mqtt.mqtt_operator import MqttSecrets, connected_mqtt_operator
from wil_campaign.plugins.mqtt.mqtt_setup import MqttSetup

pytestmark = needs_mosquitto
TOKEN = "of the test"  # noqa: S105 - opens nothing
SECRETS = MqttSecrets(token=TOKEN, password=PASSWORD)


@pytest.fixture(scope="module")
def setup(tmp_path_factory: pytest.TempPathFactory) -> Iterator[MqttSetup]:
    folder, port = tmp_path_factory.mktemp("certificates"), free_port()
    make_certificates(folder)
    with mosquitto(folder, port):
        yield MqttSetup(
            broker=BrokerAddress("localhost", port, tls=True),
            user=USER,
            ca_file=folder / "ca.pem",
            cert_file=folder / "client.pem",
            key_file=folder / "client.key",
        )


def folder_of(setup: MqttSetup) -> Path:
    assert setup.ca_file is not None
    return setup.ca_file.parent


def publish(setup: MqttSetup, kind: str, body: dict[str, object]) -> None:
    """Command as docs/operator.md says."""
    subprocess.run(  # noqa: S603
        [
            *("mosquitto_pub", "-h", "localhost", "-p", str(setup.broker.port), "-q", "1"),
            *("--cafile", "ca.pem", "--cert", "client.pem", "--key", "client.key"),
            *("-u", "anna", "-P", PASSWORD, "-t", f"wil/gate/operator/{kind}"),
            *("-m", signed_command(f"wil/gate/operator/{kind}", body, TOKEN).decode()),
        ],
        cwd=folder_of(setup),
        check=True,
        capture_output=True,
        timeout=20,
    )


async def test_commands_come_through_as_far_as_the_broker_lets_them(
    setup: MqttSetup, tmp_path: Path
) -> None:
    fleet = FakeFleet()
    controller = make_controller(tmp_path, fleet)
    async with connected_mqtt_operator(setup, SECRETS, controller):
        for number, kind in enumerate(("hold", "resume", "abort")):
            await asyncio.to_thread(
                publish,
                setup,
                kind,
                {
                    "session": controller.session,
                    "id": str(number),
                    "at": time.time(),
                    "who": "anna",
                },
            )
        async with asyncio.timeout(10.0):
            while not fleet.aborted:  # noqa: ASYNC110 - another process sets no event
                await asyncio.sleep(0.01)
    assert [(one.kind, one.who) for one in fleet.told] == [("hold", "mqtt:anna")]
    assert [one.who for one in fleet.aborted] == ["mqtt:anna"]


NOT_TRUSTED = "no word|[Cc]ertificate"
UNCLOSED = "ignore:Exception ignored in. <ssl.SSLSocket:pytest.PytestUnraisableExceptionWarning"
"""After a handshake that failed paho leaves its socket to the collector."""


@pytest.mark.parametrize(
    ("changes", "password", "why"),
    [
        ({"ca_file": "other.pem"}, PASSWORD, "(?i)certificate verify failed"),
        ({"cert_file": None, "key_file": None}, PASSWORD, NOT_TRUSTED),
        (
            {"cert_file": "stranger.pem", "key_file": "stranger.key"},
            PASSWORD,
            NOT_TRUSTED,
        ),
        (
            {"cert_file": "client.pem", "key_file": "broker.key"},
            PASSWORD,
            "(?i)key values",
        ),
        ({"ca_file": "acl"}, PASSWORD, "MQTT broker .*: ."),
        ({}, "guess", "(?i)not authori[sz]ed"),
        ({"user": ""}, PASSWORD, "(?i)not authori[sz]ed"),
    ],
)
@pytest.mark.filterwarnings(UNCLOSED)
async def test_missing_trust_on_either_side_is_an_error_at_the_start(
    setup: MqttSetup,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    *,
    changes: dict[str, str | None],
    password: str,
    why: str,
) -> None:
    # Only a broker that does not trust us may just say no word.
    connect_s = 1.0 if why == NOT_TRUSTED else 20.0
    monkeypatch.setattr("wil_campaign.plugins.mqtt.mqtt_operator._CONNECT_S", connect_s)
    found = {
        key: folder_of(setup) / value if value and key.endswith("file") else value
        for key, value in changes.items()
    }
    wrong = replace(setup, **found)  # type: ignore[arg-type]  # None is for files alone
    with pytest.raises(OperatingError, match=why):
        async with connected_mqtt_operator(
            wrong, replace(SECRETS, password=password), make_controller(tmp_path, FakeFleet())
        ):
            pass


@pytest.mark.filterwarnings(UNCLOSED)
async def test_an_address_that_the_certificate_does_not_name_is_refused(
    setup: MqttSetup, tmp_path: Path
) -> None:
    def at(host: str) -> MqttSetup:
        return replace(setup, broker=replace(setup.broker, host=host))

    controller = make_controller(tmp_path, FakeFleet())
    with pytest.raises(OperatingError, match=f"(?i)certificate.*{UNNAMED}"):
        async with connected_mqtt_operator(at(UNNAMED), SECRETS, controller):
            pass
    async with connected_mqtt_operator(at("127.0.0.1"), SECRETS, controller):
        pass
