"""Standard output as the command line hands it on."""

import io

import pytest

from wil_campaign.orchestrator.cli.standard_streams import ignore_broken_pipe


def test_the_stream_of_a_display_is_not_its_to_close(monkeypatch: pytest.MonkeyPatch) -> None:
    """From Python 3.13 on the collector reports what its `close` raises."""
    output = io.TextIOWrapper(io.BytesIO())
    monkeypatch.setattr("sys.stdout", output)
    shown = ignore_broken_pipe()
    shown.close()
    assert not output.closed
    output.close()
    ignore_broken_pipe().close()
