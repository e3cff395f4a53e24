"""The sequential test of a pass rate, against its published properties."""

import numpy as np
import pytest

from wil_campaign.campaigns.statistics.sequential_test import SequentialTest


def test_the_sequential_test_stops_when_it_knows() -> None:
    test = SequentialTest(at_least=0.95, against=0.8, most=60)
    assert test.least_flights == 18
    assert test.decided_after([True] * 60) == ("at least", 18)
    assert test.decided_after([False] * 60) == ("below", test.least_failures) == ("below", 3)
    assert test.decided_after([True] * 17) == ("undecided", 17)
    # One failure costs eight passes: 2.944 + 1.386 over 0.172.
    assert test.decided_after([False, *[True] * 59]) == ("at least", 27)
    short = SequentialTest(at_least=0.95, against=0.8, most=10)
    assert short.decided_after([True] * 60) == ("undecided", 10)


def test_the_sequential_test_errs_as_seldom_as_it_says() -> None:
    test = SequentialTest(at_least=0.95, against=0.8, most=400)
    rng = np.random.default_rng(5)

    def decided(rate: float) -> list[tuple[str, int]]:
        return [test.decided_after(list(rng.random(400) < rate)) for _ in range(800)]

    low, high = decided(0.8), decided(0.95)
    assert sum(one == "at least" for one, _ in low) / 800 < 0.06
    assert sum(one == "below" for one, _ in high) / 800 < 0.06
    assert np.mean([count for _, count in low]) == pytest.approx(23, abs=3)


def _exactly(test: SequentialTest, rate: float) -> dict[str, float]:
    """Return the probability of each decision at a pass rate, of Wald's ratio itself, exactly."""
    found = {"at least": 0.0, "below": 0.0}
    bound = (1.0 - test.error) / test.error
    waiting = {(0, 0): 1.0}
    for _ in range(test.most):
        after: dict[tuple[int, int], float] = {}
        for (passed, failed), weight in waiting.items():
            for counts, share in (((passed + 1, failed), rate), ((passed, failed + 1), 1.0 - rate)):
                ratio = (test.at_least / test.against) ** counts[0]
                ratio *= ((1.0 - test.at_least) / (1.0 - test.against)) ** counts[1]
                decision = "at least" if ratio >= bound else "below" if ratio <= 1 / bound else ""
                if decision:
                    found[decision] += weight * share
                else:
                    after[counts] = after.get(counts, 0.0) + weight * share
        waiting = after
    return {**found, "undecided": sum(waiting.values())}


@pytest.mark.parametrize("rate", [0.95, 0.9, 0.8])
def test_decisions_come_as_often_as_the_exact_distribution_says(rate: float) -> None:
    test = SequentialTest(at_least=0.95, against=0.8, most=60)
    flown = np.random.default_rng(8).random((4000, test.most)) < rate
    decisions: list[str] = [test.decided_after(passes.tolist())[0] for passes in flown]
    for decision, probability in _exactly(test, rate).items():
        assert decisions.count(decision) / 4000 == pytest.approx(probability, abs=0.03)


def test_a_cut_off_test_of_the_docs_leaves_so_much_undecided() -> None:
    found = _exactly(SequentialTest(at_least=0.95, against=0.8, most=60), 0.95)
    shares = [found[name] for name in ("at least", "below", "undecided")]
    assert shares == pytest.approx([0.90, 0.03, 0.07], abs=0.005)


@pytest.mark.parametrize(("at_least", "against"), [(0.95, 0.8), (0.9, 0.5), (0.9999, 0.7448)])
def test_a_wrong_decision_is_as_improbable_as_the_page_says(
    at_least: float, against: float
) -> None:
    """Wald's bound of each is error / (1 - error): 5.25 % of the third, which is above `error`."""
    test = SequentialTest(at_least, against, most=60)
    wrong = _exactly(test, against)["at least"], _exactly(test, at_least)["below"]
    assert max(wrong) <= 0.05 / 0.95
    assert sum(wrong) <= 2 * 0.05


@pytest.mark.parametrize("bad", [(0.8, 0.9, 5, 0.05), (1.0, 0.8, 5, 0.05), (0.9, 0.8, 0, 0.05)])
def test_an_impossible_sequential_test_is_refused(bad: tuple[float, float, int, float]) -> None:
    with pytest.raises(ValueError, match="needs"):
        SequentialTest(*bad)
