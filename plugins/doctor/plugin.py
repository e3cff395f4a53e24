"""What the plugin doctor adds."""

from wil_campaign.hooks import Command, implements


@implements
def commands() -> tuple[Command, ...]:
    """Return the command that checks this machine, or a vehicle."""
    return (
        Command(
            "doctor",
            "wil_campaign.plugins.doctor.doctor_command:doctor",
            "Check this machine: programs, ports, permissions.",
            "start",
        ),
    )
