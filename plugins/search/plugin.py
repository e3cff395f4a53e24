"""What the plugin search adds."""

from wil_campaign.hooks import CampaignKey, Command, implements


@implements
def campaign_keys() -> tuple[CampaignKey, ...]:
    """Return the key `search`."""
    return (
        CampaignKey(
            "search",
            part="wil_campaign.plugins.search.search_part:SearchPart",
            check="wil_campaign.plugins.search.exploration.search_file:read_search",
            summary="Which variants `wil-campaign search` tries to find one that fails.",
            varies=False,
        ),
    )


@implements
def commands() -> tuple[Command, ...]:
    """Return the command `search`."""
    return (
        Command(
            "search",
            "wil_campaign.plugins.search.search_command:search",
            "Look for variants of a campaign that fail, confirm and reduce them.",
            "fly",
            flies=True,
        ),
    )
