"""Things of the user's, by `file.py:Name`."""

import signal
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from wil_campaign.foundation.files.references import BadReferenceError, load_reference
from wil_campaign.foundation.files.user_modules import forget_user_modules


def test_a_file_runs_once_until_it_is_forgotten(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        "seen = []\n\ndef count():\n    seen.append(1)\n    return len(seen)\n"
    )

    def count() -> object:
        found = load_reference("mine.py:count", tmp_path)
        assert callable(found)
        return found()

    assert [count(), count()] == [1, 2]
    forget_user_modules()
    assert count() == 1


@pytest.mark.parametrize("ends", ["", "raise ValueError('no')\n"])
def test_a_file_takes_no_signal_away_that_ends_this_program(tmp_path: Path, ends: str) -> None:
    (tmp_path / "deaf.py").write_text(
        "import signal\n"
        "for one in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):\n"
        "    signal.signal(one, signal.SIG_IGN)\n"
        f"{ends}def fly(): ...\n"
    )
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(one) for one in numbers]
    try:
        if ends:
            with pytest.raises(BadReferenceError):
                load_reference("deaf.py:fly", tmp_path)
        else:
            load_reference("deaf.py:fly", tmp_path)
        assert [signal.getsignal(one) for one in numbers] == before
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


def test_threads_that_load_a_file_at_once_all_get_it_whole(tmp_path: Path) -> None:
    (tmp_path / "slow.py").write_text("import time\ntime.sleep(0.1)\nclass Thing: ...\n", "utf-8")
    with ThreadPoolExecutor(4) as threads:
        asked = [threads.submit(load_reference, "slow.py:Thing", tmp_path) for _ in range(4)]
    things = [one.result() for one in asked]
    assert things == [things[0]] * 4
