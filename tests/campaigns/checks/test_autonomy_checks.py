"""The autonomy under test is built in a child process, which may start late."""

from pathlib import Path

import pytest

from campaigns.checks import autonomy_checks
from campaigns.setup.autonomy_under_test import UnderTest


def test_a_child_that_does_not_start_in_time_is_no_built_autonomy(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(autonomy_checks, "_LONGEST_FORK_S", 0.0)
    monkeypatch.setattr(autonomy_checks, "_LONGEST_SPAWN_S", 0.0)
    missing = UnderTest(use="nowhere.py:Autonomy", folder=tmp_path, rate_hz=20.0)
    refusal = autonomy_checks.IsolatedBuilds().refusal(missing)
    assert refusal is not None
    assert "could not be checked" in refusal.message
