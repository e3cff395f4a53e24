"""Acceptance: shares of passes, and the standing of each requirement."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.campaigns.values.acceptance import (
    PassRequirement,
    PassShare,
    parse_pass_share,
    requirement_standings,
)


@pytest.mark.parametrize("text", ["", "5", "5/", "0/5", "6/5", "-1/5", "a/b", "5/5/5"])
def test_an_impossible_share_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="must"):
        parse_pass_share(text)


@given(st.integers(1, 50), st.integers(1, 50), st.integers(1, 200))
def test_a_scaled_share_is_never_laxer(passes: int, more: int, runs: int) -> None:
    share = PassShare(passes, passes + more)
    scaled = share.scaled(runs)
    assert scaled.runs == runs
    assert 1 <= scaled.passes <= runs
    assert scaled.passes / runs >= share.passes / share.runs - 1e-12


def test_standings_count_passes_of_their_own_case_and_mode() -> None:
    wanted = PassRequirement("a", "sim", PassShare(2, 3))
    runs = [("a", "sim", True), ("a", "wil", True), ("a", "sim", False), ("b", "sim", True)]
    (standing,) = requirement_standings([wanted], runs)
    assert (standing.passed, standing.flown, standing.met) == (1, 2, False)
    assert str(standing) == "a/sim: 1 passed, 2/3 required, 1 not flown"
    assert requirement_standings([wanted], [*runs, ("a", "sim", True)])[0].met
