"""What the plugin outlets adds."""

from wil_campaign.hooks import RunObserver, implements


@implements
def run_observers() -> tuple[RunObserver, ...]:
    """Return the keys `deliver` and `ground_station`."""
    return (
        RunObserver(
            "deliver",
            field="wil_campaign.plugins.outlets.deliver_part:deliver_field",
            setup="wil_campaign.plugins.outlets.deliver_part:delivery_setups",
            observe="wil_campaign.plugins.outlets.image_outlets:observe",
        ),
        RunObserver(
            "ground_station",
            field="wil_campaign.plugins.outlets.deliver_part:ground_station_field",
            setup="wil_campaign.plugins.outlets.deliver_part:ground_station_setup",
            observe="wil_campaign.plugins.outlets.ground_station:observe",
        ),
    )
