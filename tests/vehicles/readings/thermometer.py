"""A made-up type of reading that is numbers alone, as a new sensor's would be."""

from dataclasses import dataclass

from wil_campaign.vehicles.readings import Source


@dataclass(frozen=True, slots=True)
class ThermometerReading:
    t_s: float
    arrived_s: float
    seq: int
    source: Source
    temperature_deg_c: float
    samples: int
    sensor: str = ""
