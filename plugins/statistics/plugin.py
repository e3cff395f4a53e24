"""What the plugin statistics adds."""

from wil_campaign.hooks import Command, ReportSection, implements


@implements
def commands() -> tuple[Command, ...]:
    """Return the commands `plan`, `gap`, `compare` and `history`."""
    return (
        Command(
            "plan",
            "wil_campaign.plugins.statistics.plan_command:plan",
            "Show the runs of a campaign; nothing flies.",
            "start",
        ),
        Command(
            "gap",
            "wil_campaign.plugins.statistics.gap_command:gap",
            "Print pass rates by mode and the gap between them and reality.",
        ),
        Command(
            "compare",
            "wil_campaign.plugins.statistics.compare_command:compare",
            "Report whether a case became worse since earlier flights.",
        ),
        Command(
            "history",
            "wil_campaign.plugins.statistics.history_command:history",
            "Show pass rates, margins and durations of campaigns over time.",
        ),
    )


@implements
def report_sections() -> tuple[ReportSection, ...]:
    """Return the comparison of the modes."""
    return (
        ReportSection("statistics", "wil_campaign.plugins.statistics.study_section:study_section"),
    )
