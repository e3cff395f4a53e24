"""Quantities of a reading that conditions can use, by sensor type. Pure."""

from collections.abc import Mapping
from operator import attrgetter

from wil_campaign.vehicles.readings import reading_types
from wil_campaign.vehicles.readings.kinds import traits_named
from wil_campaign.vehicles.readings.numbers import number_fields_of_reading
from wil_campaign.vehicles.readings.traits import Quantity


def quantities_of(kind: str) -> Mapping[str, Quantity]:
    """Return a sensor type's quantities by name; an array where a reading has many elements."""
    if (known := traits_named(kind).quantities) is not None:
        return known
    return {name: attrgetter(name) for name in number_fields_of_reading(reading_types()[kind])}
