"""What the plugin readings adds."""

from wil_campaign.hooks import SensorSource, implements

_PLACE = "wil_campaign.plugins.readings.reading_sources"


@implements
def sources() -> tuple[SensorSource, ...]:
    """Return the sources of readings that the core's schema names without a scheme of their own."""
    return (
        SensorSource(
            "zmq", "tcp://HOST:PORT", f"{_PLACE}:published", f"{_PLACE}:fault", is_file=False
        ),
        SensorSource("mcap", "FILE.mcap", f"{_PLACE}:recorded", f"{_PLACE}:fault", is_file=True),
    )
