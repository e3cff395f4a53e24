"""The bench that puts faults into the code finds one that has a test."""

from pathlib import Path

from bench.mutation import ROOT, Tree, candidates_of, mutant_of

_WITHIN_S = 100.0


def test_a_fault_in_the_code_is_found_by_its_test(tmp_path: Path) -> None:
    candidates = candidates_of(ROOT / "worlds" / "figures.py")
    mutants = [mutant for one in candidates if (mutant := mutant_of(one)) is not None]
    wrong = next(one for one in mutants if one.after == "return None")
    assert Tree(tmp_path, _WITHIN_S).finder_of(wrong, []) is not None
