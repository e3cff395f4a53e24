"""What a campaign may say of its operators' broker."""

import pytest

from tests.campaigns.conftest import Files
from wil_campaign.plugins.mqtt.broker_address import BrokerAddress
from wil_campaign.plugins.mqtt.mqtt_setup import MqttSetup


def operator(files: Files, text: str) -> object:
    files.change("seed: 7", f"seed: 7\noperator: {text}")
    return files.load().operators["mqtt"]


def test_without_a_broker_there_is_no_setup(files: Files) -> None:
    assert files.load().operators == {}


def test_every_key_is_read(files: Files) -> None:
    for name in ("ca.pem", "me.pem", "me.key"):
        (files.folder / name).write_text("")
    found = operator(
        files,
        "{mqtt: {broker: mqtts://anna@broker, password_env: PASS, token_env: TOKEN, root: lab/1, "
        "ca_file: ca.pem, cert_file: me.pem, key_file: me.key}, on_operator_loss: hold, "
        "lost_after_s: 3}",
    )
    assert found == MqttSetup(
        broker=BrokerAddress("broker", 8883, tls=True, user="anna"),
        user="anna",
        password_env="PASS",  # noqa: S106 - names of variables
        token_env="TOKEN",  # noqa: S106
        ca_file=files.folder / "ca.pem",
        cert_file=files.folder / "me.pem",
        key_file=files.folder / "me.key",
        root="lab/1",
        on_loss="hold",
        lost_after_s=3.0,
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{mqtt: {broker: http://x}}", "broker 'http://x' cannot be read"),
        ("{mqtt: {broker: mqtt://x, ca_file: ca.pem}}", ": is for TLS"),
        ("{mqtt: {broker: mqtts://x, key_file: me.key}}", "needs the cert_file"),
        ("{mqtt: {broker: mqtts://x, ca_file: ca.pem}}", "there is no file 'ca.pem'"),
        ("{mqtt: {broker: mqtt://x, root: a/+}}", "'a/+' is not a topic"),
        ("{mqtt: {broker: mqtt://x, token_env: a b}}", "'a b' is not the name of an env"),
        ("{mqtt: {broker: mqtt://x, tokn_env: a}}", "did you mean 'token_env'"),
        ("{on_operator_loss: panic}", "continue"),
        ("{lost_after_s: 0}", "greater than 0"),
    ],
)
def test_a_wrong_mqtt_setup_is_reported_with_its_place(files: Files, text: str, said: str) -> None:
    files.change("seed: 7", f"seed: 7\noperator: {text}")
    (problem,) = files.faults()
    assert said in problem
    assert problem.startswith("campaign.yaml:27:")
