"""What the plugin offline adds."""

from wil_campaign.hooks import Command, implements


@implements
def commands() -> tuple[Command, ...]:
    """Return the commands `mix` and `replay`."""
    return (
        Command(
            "mix",
            "wil_campaign.plugins.offline.mix_command:mix",
            "Mix images, videos or recordings by a recipe.",
        ),
        Command(
            "replay",
            "wil_campaign.plugins.offline.replay_command:replay_run",
            "Mix a recorded run again; nothing flies.",
        ),
    )
