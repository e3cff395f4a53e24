"""Addresses of MQTT brokers: which are read, and which are refused."""

import pytest

from wil_campaign.plugins.mqtt.broker_address import (
    BrokerAddress,
    BrokerAddressError,
    parse_broker_address,
)


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("embedded", BrokerAddress("127.0.0.1", 1883, embedded=True)),
        ("embedded:1884", BrokerAddress("127.0.0.1", 1884, embedded=True)),
        ("mqtt://broker", BrokerAddress("broker", 1883)),
        ("mqtts://anna@[::1]:9000/", BrokerAddress("::1", 9000, tls=True, user="anna")),
    ],
)
def test_brokers_are_read(text: str, address: BrokerAddress) -> None:
    assert parse_broker_address(text) == address


@pytest.mark.parametrize(
    "text",
    [
        *("", "broker", "http://broker", "mqtt://", "mqtt://broker:99999", "mqtt://broker/x"),
        *("mqtt://broker?x=1", "embedded:-1", "embedded:0", "embedded:x", "mqtt://[::1"),
    ],
)
def test_an_address_that_is_no_broker_is_refused(text: str) -> None:
    with pytest.raises(BrokerAddressError):
        parse_broker_address(text)


def test_a_password_in_an_address_is_refused_and_not_repeated() -> None:
    with pytest.raises(BrokerAddressError, match="password_env") as refused:
        parse_broker_address("mqtt://anna:hidden@broker")
    assert "hidden" not in str(refused.value)
