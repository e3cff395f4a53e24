"""What the plugin injection adds."""

from wil_campaign.hooks import RunObserver, implements


@implements
def run_observers() -> tuple[RunObserver, ...]:
    """Return the key `inject`."""
    return (
        RunObserver(
            "inject",
            field="wil_campaign.plugins.injection.injection_part:inject_field",
            setup="wil_campaign.plugins.injection.injection_part:injection_setups",
            observe="wil_campaign.plugins.injection.injections:observe",
        ),
    )
