"""Things of the user's, by `file.py:Name`."""

from pathlib import Path

from worlds.files.references import forget_loaded, load_reference


def test_a_file_runs_once_until_it_is_forgotten(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        "seen = []\n\ndef count():\n    seen.append(1)\n    return len(seen)\n"
    )

    def count() -> object:
        found = load_reference("mine.py:count", tmp_path)
        assert callable(found)
        return found()

    assert [count(), count()] == [1, 2]
    forget_loaded()
    assert count() == 1
