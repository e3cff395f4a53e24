"""The files that runs read anew: what counts as a change of them while a campaign flies."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.orchestrator.hover import write_hover
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.orchestrator.campaign.folder.campaign_folder import OutputError
from wil_campaign.orchestrator.campaign.folder.flown_files import FlownFiles
from wil_campaign.orchestrator.campaign.folder.manifest import file_digest, maybe_written_files
from wil_campaign.vehicles.embedded import profile


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
    read = [tmp_path / digest for digest in digests]
    files = FlownFiles.of(campaign, digests, read=read, skipped=[campaign])
    files.require_unchanged()
    change(tmp_path / name)
    if is_refused:
        with pytest.raises(OutputError, match=r"autonomy\.py changed while the campaign flew"):
            files.require_unchanged()
    else:
        files.require_unchanged()
        files.require_unchanged()


def test_code_that_only_a_run_knows_is_watched_from_then_on(tmp_path: Path) -> None:
    (tmp_path / "late.py").write_text("x = 1")
    code = {"late.py": file_digest(tmp_path / "late.py")}
    files = FlownFiles.of(tmp_path / "campaign.yaml", {}, read=[], skipped=[])
    files.require_same_code("a/sim/1", code)
    files.require_same_code("a/sim/2", code)
    files.require_code_on_disk("a/sim/1", code)
    (tmp_path / "late.py").write_text("x = 2")
    changed = {"late.py": file_digest(tmp_path / "late.py")}
    with pytest.raises(OutputError, match=r"late\.py changed while the campaign flew: a/sim/3"):
        files.require_same_code("a/sim/3", changed)
    with pytest.raises(OutputError, match=r"late\.py changed since a/sim/1 flew with it"):
        files.require_code_on_disk("a/sim/1", code)
    (tmp_path / "late.py").unlink()
    with pytest.raises(OutputError, match=r"late\.py is missing since a/sim/1 flew with it"):
        files.require_code_on_disk("a/sim/1", code)


def test_a_profile_of_the_program_is_watched_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A checkout may be edited, or another commit of it checked out, while a campaign flies."""
    monkeypatch.setattr(profile, "_FOLDER", tmp_path)
    (tmp_path / "cage.yaml").write_text("base: nominal")
    files = FlownFiles.of(tmp_path / "campaign.yaml", {}, read=[], skipped=[])
    files.require_unchanged()
    (tmp_path / "cage.yaml").write_text("base: px4-sih")
    with pytest.raises(OutputError, match=r"cage\.yaml changed while the campaign flew"):
        files.require_unchanged()


def test_a_symlink_that_points_elsewhere_is_a_change(tmp_path: Path) -> None:
    link, digests = tmp_path / "net.onnx", dict[str, str]()
    for number in (1, 2):
        path = tmp_path / f"net-{number}.onnx"
        path.write_text(f"network {number}")
        digests[path.name] = file_digest(path)
    link.symlink_to("net-1.onnx")
    files = FlownFiles.of(tmp_path / "campaign.yaml", digests, read=[link], skipped=[])
    files.require_unchanged()
    link.unlink()
    link.symlink_to("net-2.onnx")
    with pytest.raises(OutputError, match=r"net\.onnx changed while the campaign flew"):
        files.require_unchanged()


def test_files_that_only_the_user_s_code_is_given_may_be_written(tmp_path: Path) -> None:
    path = write_hover(tmp_path)
    for name in ("fly.py", "flight.log", "gains.txt", "net.onnx"):
        (tmp_path / name).write_text("1")
    program = "{program: [python3, fly.py, --log, flight.log], with: {a: gains.txt, b: net.onnx}}"
    path.write_text(path.read_text().replace("still.py:Still", program))
    found = maybe_written_files(load_campaign(path, ExpansionOptions()))
    assert found == {tmp_path / "flight.log", tmp_path / "gains.txt"}
