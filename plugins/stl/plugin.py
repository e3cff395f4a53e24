"""What the plugin stl adds."""

from wil_campaign.hooks import CaseHints, OracleKind, implements


@implements
def oracles() -> tuple[OracleKind, ...]:
    """Return the oracle of formulas."""
    return (OracleKind("stl", "wil_campaign.plugins.stl.stl_oracle:stl"),)


@implements
def case_hints() -> tuple[CaseHints, ...]:
    """Return the warnings of formulas that no flight decides."""
    return (CaseHints("formulas", "wil_campaign.plugins.stl.formula_hints:formula_hints"),)
