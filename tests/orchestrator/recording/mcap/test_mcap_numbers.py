"""A sensor type whose readings are numbers is recorded and read back without code of its own."""

import json
from typing import Any

import pytest

from tests.vehicles.readings.thermometer import ThermometerReading
from wil_campaign.orchestrator.recording.mcap import mcap_decode
from wil_campaign.orchestrator.recording.mcap.mcap_bodies import reading_body
from wil_campaign.orchestrator.recording.mcap.mcap_decode import decode_reading_message
from wil_campaign.orchestrator.recording.mcap.mcap_schemas import _numbers
from wil_campaign.vehicles.readings.messages import encode_message
from wil_campaign.vehicles.sensors.sensor_spec import SensorSpec


def test_numbers_come_back_to_the_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = SensorSpec("thermometer", ThermometerReading)
    monkeypatch.setattr(mcap_decode, "sensor_specs", lambda: {"thermometer": spec})
    reading: Any = ThermometerReading(1.25, 1.5, 7, "twin", 0.1 + 0.2, 4, "cabin")
    schema, fields, data = reading_body(reading)
    stamps = {"t_s": 1.25, "arrived_s": 1.5, "seq": 7, "source": "twin", "sensor": "cabin"}
    text = encode_message({**fields, "wil": {"type": "thermometer", **stamps}})
    assert (schema, data) == ("wil.ThermometerReading", None)
    again: Any = decode_reading_message(json.loads(text), {})
    assert again == reading
    assert isinstance(again.samples, int)


def test_the_schema_names_each_number() -> None:
    properties = _numbers(ThermometerReading)["properties"]
    assert properties["temperature_deg_c"] == properties["samples"] == {"type": "number"}


def test_an_unknown_type_is_a_value_error() -> None:
    with pytest.raises(ValueError, match="no sensor type barometer"):
        decode_reading_message({"wil": {"type": "barometer"}}, {})
