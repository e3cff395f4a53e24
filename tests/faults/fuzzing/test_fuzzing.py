"""Every decoder and port takes or refuses what is not as it should be, and raises nothing else."""

import random
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.faults.fuzzing import fuzzer
from tests.faults.fuzzing.fuzzer import TARGETS, feed
from tests.faults.fuzzing.mutations import mutated
from tests.faults.fuzzing.targets import Prepared, Target

_FIRST = 1_000_000
"""Numbers that bench/fuzz.py does not reach."""


def _folder(path: Path) -> Path:
    path.mkdir()
    return path


# tests/campaigns/schema/test_fuzz_campaigns.py spoils campaigns.
@pytest.mark.parametrize("name", sorted(TARGETS.keys() - {"campaign"}))
def test_bad_input_is_refused_in_words(tmp_path: Path, name: str) -> None:
    target = TARGETS[name]
    if target.takes_seeds:
        prepared = target.prepare(_folder(tmp_path / "seeds"))
        for seed in prepared.seeds:
            prepared.take(seed)
    count = 3 if name == "network" else 15  # each network is tried in a process of its own
    fed = feed(target, _folder(tmp_path / "fed"), _FIRST, count)
    assert fed.failures == []
    assert fed.inputs == fed.taken + fed.refused == count


def test_a_target_that_raises_is_found(tmp_path: Path) -> None:
    target = TARGETS["formula"]
    spoilt = type(target)(target.name, (), target.prepare)
    assert feed(spoilt, tmp_path, _FIRST, 40).failures


def _spin(_: bytes) -> None:
    while True:
        pass


def _wait(_: bytes) -> None:
    threading.Event().wait()


@pytest.mark.parametrize(("take", "of"), [(_spin, "the processor"), (_wait, "the wall clock")])
def test_a_hang_is_time_of_the_processor_or_much_of_the_wall_clock(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, take: Callable[[bytes], None], of: str
) -> None:
    monkeypatch.setattr(fuzzer, "LONGEST_CPU_S", 0.1)
    monkeypatch.setattr(fuzzer, "LONGEST_WALL_S", 0.3 if take is _wait else 60.0)
    hanging = Target("hanging", (), lambda _: Prepared((b"seed",), take))
    [(number, text)] = feed(hanging, tmp_path, _FIRST, 1).failures
    assert number == _FIRST
    assert f"s of {of}" in text


def test_inputs_follow_from_their_numbers() -> None:
    seeds = (b"[1, 2, 3]", b"always (x <= 1)")
    once, again = ([mutated(random.Random(k), seeds) for k in range(50)] for _ in range(2))  # noqa: S311
    assert once == again
    assert len(set(once)) > 40


def test_a_length_beyond_the_address_space_is_damage(tmp_path: Path) -> None:
    fed = feed(TARGETS["recording"], tmp_path, 1797, 1)
    assert (fed.failures, fed.taken) == ([], 1)


def test_a_network_that_ends_the_process_of_its_reader_is_refused(tmp_path: Path) -> None:
    """OpenCV's reader dies of SIGSEGV on it; fed in this very process, it would end the tests."""
    fed = feed(TARGETS["network"], tmp_path, 2353, 1)
    assert (fed.failures, fed.refused) == ([], 1)
