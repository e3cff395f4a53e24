"""The files that runs read anew: what counts as a change of them while a campaign flies."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from orchestrator.campaign.folder.campaign_folder import OutputError
from orchestrator.campaign.folder.flown_files import FlownFiles
from orchestrator.campaign.folder.manifest import file_digest


def replace_content(path: Path) -> None:
    path.write_text("other")


def replace_unnoticed_by_time(path: Path) -> None:
    facts = path.stat()
    new = path.with_suffix(".new")
    new.write_text("y = 1")
    os.utime(new, ns=(facts.st_atime_ns, facts.st_mtime_ns))
    new.rename(path)


def write_again(path: Path) -> None:
    path.with_suffix(".new").write_text(path.read_text())
    path.with_suffix(".new").rename(path)


@pytest.mark.parametrize(
    ("name", "change", "is_refused"),
    [
        ("own/autonomy.py", replace_content, True),
        ("own/autonomy.py", replace_unnoticed_by_time, True),
        ("own/autonomy.py", Path.unlink, True),
        ("own/autonomy.py", Path.touch, False),
        ("own/autonomy.py", write_again, False),
        ("campaign.yaml", replace_content, False),
    ],
)
def test_another_content_is_a_change_unless_no_run_reads_it(
    tmp_path: Path, name: str, change: Callable[[Path], None], is_refused: bool
) -> None:
    (tmp_path / "own").mkdir()
    digests: dict[str, str] = {}
    for one in ("campaign.yaml", "own/autonomy.py"):
        (tmp_path / one).write_text("x = 1")
        digests[one] = file_digest(tmp_path / one)
    campaign = tmp_path / "campaign.yaml"
    files = FlownFiles.of(campaign, digests, [campaign])
    files.require_unchanged()
    change(tmp_path / name)
    if is_refused:
        with pytest.raises(OutputError, match=r"autonomy\.py changed while the campaign flew"):
            files.require_unchanged()
    else:
        files.require_unchanged()
        files.require_unchanged()
