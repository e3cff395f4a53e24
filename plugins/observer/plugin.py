"""What the plugin observer adds."""

from wil_campaign.hooks import CampaignKey, Command, RunSection, implements


@implements
def campaign_keys() -> tuple[CampaignKey, ...]:
    """Return the key `observer`."""
    return (
        CampaignKey(
            "observer",
            part="wil_campaign.plugins.observer.observer_part:ObserverPart",
            check="wil_campaign.plugins.observer.observer_part:check_observer",
            summary="A fixed camera that looks at the world from outside; it costs no flight time.",
            varies=False,
        ),
    )


@implements
def commands() -> tuple[Command, ...]:
    """Return the command `film`."""
    return (
        Command(
            "film",
            "wil_campaign.plugins.observer.film_command:film",
            "Draw a recorded run as a fixed camera would see it from outside.",
        ),
    )


@implements
def run_sections() -> tuple[RunSection, ...]:
    """Return the moment of a run as the observer sees it."""
    return (
        RunSection("observer", "wil_campaign.plugins.observer.observer_section:observer_section"),
    )
