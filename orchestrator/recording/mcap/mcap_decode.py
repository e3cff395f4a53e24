"""Decodes messages of run.mcap as readings, exact to the bit where recorded exactly; pure."""

from typing import Any

from mcap.records import Channel

from wil_campaign.hooks import sensor_types
from wil_campaign.installed_plugins import absent_additions
from wil_campaign.vehicles.readings import Reading
from wil_campaign.vehicles.readings.kinds import sensor_specs
from wil_campaign.vehicles.readings.messages import Json, number_from_json
from wil_campaign.vehicles.readings.numbers import number_fields_of_reading
from wil_campaign.vehicles.readings.traits import Parts


def is_reading_channel(channel: Channel) -> bool:
    """Return whether a channel's messages are readings, or images that are drawn again."""
    return channel.metadata.get("part") in {"reading", "drawing"}


def reading_topic(channel: Channel) -> str:
    """Return the topic of a channel's readings, which that of drawings has below it."""
    return f"/{channel.metadata['source']}/{channel.metadata['sensor']}"


def decode_reading_message(document: Json, parts: Parts) -> Reading:
    """Return the reading decoded from an MCAP message.

    Raises KeyError, ValueError or TypeError for a foreign document, or a type of an absent plugin.
    """
    wil = document["wil"]
    spec = sensor_specs().get(wil["type"])
    if spec is None:
        raise ValueError(
            absent_additions(sensor_types).get(wil["type"], f"no sensor type {wil['type']}")
        )
    decoded = spec.traits.decode
    kind: Any = spec.reading
    reading: Reading = kind(
        t_s=number_from_json(wil["t_s"]),
        arrived_s=number_from_json(wil["arrived_s"]),
        seq=wil["seq"],
        source=wil["source"],
        sensor=wil.get("sensor", ""),
        **(_numbers(document, kind) if decoded is None else decoded(document, parts)),
    )
    return reading


def _numbers(document: Json, kind: type[Any]) -> dict[str, float]:
    return {
        name: of(number_from_json(document[name]))
        for name, of in number_fields_of_reading(kind).items()
    }
