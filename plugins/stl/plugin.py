"""What the plugin stl adds."""

from wil_campaign.hooks import OracleKind, implements


@implements
def oracles() -> tuple[OracleKind, ...]:
    """Return the oracle of formulas."""
    return (OracleKind("stl", "wil_campaign.plugins.stl.stl_oracle:stl"),)
