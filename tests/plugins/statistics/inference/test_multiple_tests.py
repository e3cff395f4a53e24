"""Several tests at once."""

import pytest

from wil_campaign.plugins.statistics.inference.multiple_tests import holm_corrected
from wil_campaign.plugins.statistics.inference.permutation_test import permutation_p


def test_holms_correction_is_as_in_its_example() -> None:
    assert holm_corrected([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm_corrected([]) == []


def test_the_permutation_test_counts_the_ways() -> None:
    # The lowest 3 of 6 values: one way of twenty.
    assert permutation_p([1.0, 2.0, 3.0], [4.0, 5.0, 6.0]) == pytest.approx(1 / 20)
    assert permutation_p([4.0, 5.0, 6.0], [1.0, 2.0, 3.0]) == 1.0
    assert permutation_p([1.0, 1.0], [1.0, 1.0]) == 1.0
    assert permutation_p([], [1.0]) == 1.0


def test_the_permutation_test_of_many_values_is_drawn() -> None:
    low, high = [float(n) for n in range(20)], [float(n) + 5.0 for n in range(20)]
    stats = pytest.importorskip("scipy.stats")
    reference = stats.ttest_ind(low, high, alternative="less").pvalue
    assert permutation_p(low, high) == pytest.approx(reference, abs=0.01)
