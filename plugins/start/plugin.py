"""What the plugin start adds."""

from wil_campaign.hooks import Command, implements


@implements
def commands() -> tuple[Command, ...]:
    """Return the commands that help with files, and fly nothing."""
    return (
        Command(
            "init",
            "wil_campaign.plugins.start.init_command:init",
            "Write a campaign that is ready to fly, as a starting point.",
            "start",
        ),
        Command(
            "schema",
            "wil_campaign.plugins.start.schema_command:schema",
            "Write JSON Schemas of the files, for editors.",
            "start",
        ),
        Command(
            "list",
            "wil_campaign.plugins.start.list_command:list_available",
            "List campaigns, operators, autonomies, oracles, signals and plugins.",
            "start",
        ),
    )
