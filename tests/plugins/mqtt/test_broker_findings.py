"""What `wil-campaign doctor` finds of MQTT brokers on this machine."""

import socket

from wil_campaign.plugins.mqtt.broker_findings import machine_findings


def test_a_broker_that_answers_or_could_be_started() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        (answers,) = machine_findings(lambda _: None, port, "no_such_module")
    assert answers.grade == "good"
    (sleeps,) = machine_findings(lambda name: f"/bin/{name}", port, "no_such_module")
    assert (sleeps.grade, sleeps.remedy) == ("note", "mosquitto -d")
    lacks, own = machine_findings(lambda _: None, port, "json")
    assert "mosquitto is not on PATH" in lacks.text
    assert own.text.startswith("json, a broker")
