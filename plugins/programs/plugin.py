"""What the plugin programs adds."""

from wil_campaign.hooks import AutonomyKind, implements


@implements
def autonomy_kinds() -> tuple[AutonomyKind, ...]:
    """Return the kind `program`."""
    return (
        AutonomyKind(
            "program",
            value="a command line",
            field="wil_campaign.plugins.programs.program_autonomy:program_field",
            setup="wil_campaign.plugins.programs.program_autonomy:program_autonomy",
            runner="wil_campaign.plugins.programs.program_runner:program_runner",
        ),
    )
