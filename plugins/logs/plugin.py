"""What the plugin logs adds."""

from wil_campaign.hooks import Starter, implements


@implements
def starters() -> tuple[Starter, ...]:
    """Return the start from a flight log."""
    return (Starter("log", "wil_campaign.plugins.logs.start:files_from_log"),)
