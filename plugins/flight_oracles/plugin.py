"""What the plugin flight_oracles adds."""

from wil_campaign.hooks import CaseHints, OracleKind, implements


@implements
def oracles() -> tuple[OracleKind, ...]:
    """Return the oracles of motion, of an autopilot's health, and of the pair."""
    return (
        OracleKind("estimator", "wil_campaign.plugins.flight_oracles.autopilot_health:estimator"),
        OracleKind("battery", "wil_campaign.plugins.flight_oracles.autopilot_health:battery"),
        OracleKind("modes", "wil_campaign.plugins.flight_oracles.autopilot_health:modes"),
        OracleKind("speed", "wil_campaign.plugins.flight_oracles.motion:speed"),
        OracleKind("attitude", "wil_campaign.plugins.flight_oracles.motion:attitude"),
        OracleKind("twin_divergence", "wil_campaign.plugins.flight_oracles.pair:twin_divergence"),
    )


@implements
def case_hints() -> tuple[CaseHints, ...]:
    """Return the warnings of limits that no flight exceeds."""
    return (CaseHints("limits", "wil_campaign.plugins.flight_oracles.limit_hints:limit_hints"),)
