"""What the plugin encounters adds."""

from wil_campaign.hooks import OracleKind, implements


@implements
def oracles() -> tuple[OracleKind, ...]:
    """Return the oracles of distances to objects."""
    return (
        OracleKind("distance", "wil_campaign.plugins.encounters.distance:distance"),
        OracleKind("encounter", "wil_campaign.plugins.encounters.encounter:encounter"),
    )
