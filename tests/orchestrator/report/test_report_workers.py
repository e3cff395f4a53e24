"""The report's processes: where there can be none, this one writes it."""

from pathlib import Path
from typing import Any

import pytest

from wil_campaign.foundation.processes import parallel_calls
from wil_campaign.orchestrator.report import campaign_report


def test_a_report_needs_no_shared_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """A container whose /dev/shm is read-only or missing has no semaphores for a pool."""

    def refuse(*_: object, **__: object) -> None:
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr(parallel_calls, "ProcessPoolExecutor", refuse)
    monkeypatch.setattr(campaign_report, "plugin_additions", lambda _: {})
    monkeypatch.setattr(campaign_report, "_page", str)
    orders: list[Any] = list(range(100))
    documents: Any = None
    pages, sections = campaign_report._pages_and_sections(orders, Path(), documents, 2)
    assert list(map(str, pages)) == list(map(str, range(100)))
    assert sections == []
