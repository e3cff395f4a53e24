"""What the plugin hints adds."""

from wil_campaign.hooks import CaseHints, implements


@implements
def case_hints() -> tuple[CaseHints, ...]:
    """Return the warnings of limits, sizes, places and mixtures that nobody means."""
    return (CaseHints("unlikely", "wil_campaign.plugins.hints.case_hints:case_hints"),)
