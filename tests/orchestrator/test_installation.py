"""The program names its version and commit, and what pip installs it from on another machine."""

import json
import os
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from wil_campaign.orchestrator import installation
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.installation import UNKNOWN_COMMIT, commit_of, requirement_of

SHA = "0123456789abcdef0123456789abcdef01234567"
OTHER = SHA[::-1]
SHA256 = "ab" * 32
GIT = {"vcs": "git", "commit_id": SHA, "requested_revision": "main"}
GIT_HERE = shutil.which("git")
needs_git = pytest.mark.skipif(GIT_HERE is None, reason="git is not on the path")


def git(folder: Path, *words: str) -> str:
    """Run git without the settings of this machine."""
    person = ("-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false")
    done = subprocess.run(  # noqa: S603
        ["git", *person, *words],  # noqa: S607
        cwd=folder,
        env={"PATH": os.environ["PATH"], "HOME": str(folder), "GIT_CONFIG_NOSYSTEM": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A checkout that passes for one of this project."""
    root = tmp_path / "checkout"
    (root / "wil_campaign").mkdir(parents=True)
    (root / "pyproject.toml").write_text('[project]\nname = "wil-campaign"\n')
    (root / "wil_campaign" / "api.py").write_text("")
    git(root, "init", "-q")
    git(root, "add", ".")
    git(root, "commit", "-q", "-m", "first")
    git(root, "tag", "v9")
    return root


@needs_git
def test_git_knows_the_commit_of_a_checkout_and_whether_it_is_changed(checkout: Path) -> None:
    head = git(checkout, "rev-parse", "HEAD")
    assert commit_of(checkout / "wil_campaign", None) == head
    (checkout / "wil_campaign" / "api.py").write_text("changed = 1")
    assert commit_of(checkout / "wil_campaign", None) == f"{head}-dirty"


@needs_git
def test_the_checkout_is_asked_under_a_git_hook_and_not_the_hooks_repository(
    checkout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    head = git(checkout, "rev-parse", "HEAD")
    users = tmp_path / "users"
    users.mkdir()
    git(users, "init", "-q")
    git(users, "commit", "-q", "--allow-empty", "-m", "theirs")
    monkeypatch.setenv("GIT_DIR", str(users / ".git"))
    monkeypatch.setenv("GIT_INDEX_FILE", str(users / ".git" / "index"))
    assert commit_of(checkout / "wil_campaign", None) == head


@needs_git
def test_a_checkout_of_another_owner_has_a_commit(
    checkout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    head = git(checkout, "rev-parse", "HEAD")
    programs = tmp_path / "bin"
    programs.mkdir()
    foreign = programs / "git"
    foreign.write_text(f'#!/bin/sh\nGIT_TEST_ASSUME_DIFFERENT_OWNER=1 exec {GIT_HERE} "$@"\n')
    foreign.chmod(0o755)
    monkeypatch.setenv("PATH", f"{programs}:{os.environ['PATH']}")
    assert commit_of(checkout / "wil_campaign", None) == head


@needs_git
@pytest.mark.parametrize("spoil", ["no git", "in a user's repository", "no commit", "broken"])
def test_a_checkout_that_git_does_not_know_has_an_unknown_commit(
    checkout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, spoil: str
) -> None:
    if spoil == "no git":
        monkeypatch.setenv("PATH", str(tmp_path))
    elif spoil == "in a user's repository":
        (checkout / "pyproject.toml").write_text('[project]\nname = "mine"\n')
    else:
        shutil.rmtree(checkout / ".git")
        if spoil == "no commit":
            git(checkout, "init", "-q")
        else:
            (checkout / ".git").write_text("gitdir: nowhere")
    assert commit_of(checkout / "wil_campaign", None) == UNKNOWN_COMMIT


@needs_git
def test_a_copy_within_a_users_repository_does_not_have_its_commit(checkout: Path) -> None:
    inside = checkout / "vendored" / "wil_campaign"
    inside.mkdir(parents=True)
    shutil.copy(checkout / "pyproject.toml", inside.parent)
    assert commit_of(inside, None) == UNKNOWN_COMMIT


def test_a_wheel_has_its_commit_from_its_build_and_else_from_pip(tmp_path: Path) -> None:
    package = tmp_path / "wil_campaign"
    package.mkdir()
    assert commit_of(package, {"url": "https://a.b/c", "vcs_info": GIT}) == SHA
    assert commit_of(package, {"url": "file:///c", "dir_info": {}}) == UNKNOWN_COMMIT
    (package / "COMMIT").write_text(f"{OTHER}-dirty\n")
    assert commit_of(package, {"url": "https://a.b/c", "vcs_info": GIT}) == f"{OTHER}-dirty"
    (package / "COMMIT").write_text("")  # built where there was no git
    assert commit_of(package, None) == UNKNOWN_COMMIT


@pytest.mark.parametrize(
    ("recorded", "requirement"),
    [
        (
            {"url": "https://a.b/c/d.git", "vcs_info": GIT},
            f"wil-campaign @ git+https://a.b/c/d.git@{SHA}",
        ),
        (
            {"url": "ssh://git:secret@a.b/c.git", "vcs_info": GIT, "subdirectory": "e/f"},
            f"wil-campaign @ git+ssh://git@a.b/c.git@{SHA}#subdirectory=e/f",
        ),
        (
            {"url": "https://me:secret@a.b:8443/c.git?t=secret", "vcs_info": GIT},
            f"wil-campaign @ git+https://a.b:8443/c.git@{SHA}",
        ),
        (
            {"url": "https://a.b/w-1-py3-none-any.whl", "archive_info": {}},
            "wil-campaign @ https://a.b/w-1-py3-none-any.whl",
        ),
        (
            {"url": "https://a.b/w.whl", "archive_info": {"hashes": {"sha256": SHA256}}},
            f"wil-campaign @ https://a.b/w.whl#sha256={SHA256}",
        ),
        ({"url": "file:///src/w", "vcs_info": GIT}, None),
        ({"url": "file:///src/w.whl", "archive_info": {}}, None),
        ({"url": "file:///src/w", "dir_info": {"editable": True}}, None),
        ({"url": "https://a.b/${{ secrets.X }}.whl", "archive_info": {}}, None),
        ({"url": "https://a.b/c'; rm -r .git", "vcs_info": GIT}, None),
        ({"url": "https://[a/c.git", "vcs_info": GIT}, None),
        ({"url": "https://a.b/c.git", "vcs_info": {"vcs": "git", "commit_id": "; x"}}, None),
        ({"url": "https://a.b/c", "vcs_info": {**GIT, "vcs": "hg"}}, None),
        ({"url": 3, "archive_info": 4}, None),
        ({}, None),
    ],
)
def test_the_requirement_names_the_source_that_pip_recorded(
    recorded: Mapping[str, Any], requirement: str | None
) -> None:
    assert requirement_of(recorded) == requirement


class Installed:
    """A distribution in whose folder the running code lies. recorded: its direct_url.json."""

    version = "7.1"

    def __init__(self, recorded: str | None, folder: Path | None = None) -> None:
        self._recorded = recorded
        self._folder = folder or installation._PACKAGE.parent

    def locate_file(self, _: str) -> Path:
        return self._folder

    def read_text(self, name: str) -> str | None:
        assert name == "direct_url.json"
        return self._recorded


@pytest.mark.parametrize(
    ("recorded", "requirement"),
    [
        (None, "wil-campaign==7.1"),
        (json.dumps({"url": "https://a.b/c.whl", "archive_info": {}}), "wil-campaign @ https://"),
        (json.dumps({"url": "file:///c.whl", "archive_info": {}}), None),
        ("{", None),
        ("[]", None),
    ],
)
def test_an_installation_without_a_record_came_from_an_index(
    monkeypatch: pytest.MonkeyPatch, recorded: str | None, requirement: str | None
) -> None:
    monkeypatch.setattr(installation, "_distribution", lambda: Installed(recorded))
    found = installation.pip_requirement()
    assert (found is None) if requirement is None else (found or "").startswith(requirement)


def test_code_that_is_not_the_installed_one_came_from_a_folder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """PYTHONPATH leads to a checkout, beside a wheel that came from an index."""
    monkeypatch.setattr(installation, "_distribution", lambda: Installed(None, tmp_path))
    assert installation.pip_requirement() is None
    monkeypatch.setattr(installation, "_distribution", lambda: None)
    assert installation.pip_requirement() is None


@pytest.mark.parametrize(
    ("changed", "is_other"),
    [("vehicles/links/udp.py", True), ("vehicles/profiles/cage.yaml", True), ("docs/a.md", False)],
)
def test_the_digest_of_the_code_has_what_flights_go_by(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, changed: str, *, is_other: bool
) -> None:
    monkeypatch.setattr(installation, "_HOME", tmp_path)
    monkeypatch.setattr(installation, "_PACKAGE", tmp_path / "wil_campaign")
    digests = []
    for text in ("drag: 1", "drag: 2"):
        (tmp_path / changed).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / changed).write_text(text)
        digests.append(installation.code_digest.__wrapped__())
    assert (digests[0] != digests[1]) is is_other


def test_the_version_has_the_commit(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.strip().endswith(f"{installation._commit_text()})")


@pytest.mark.parametrize(
    ("commit", "text", "has_code"),
    [
        (SHA, f"7.1 (commit {SHA}", False),
        (f"{SHA}-dirty", f"7.1 (commit {SHA}-dirty", True),
        (UNKNOWN_COMMIT, "7.1 (unknown commit", True),
    ],
)
def test_a_program_without_a_clean_commit_is_identified_by_its_code(
    monkeypatch: pytest.MonkeyPatch, commit: str, text: str, *, has_code: bool
) -> None:
    monkeypatch.setattr(installation, "_distribution", lambda: Installed(None))
    monkeypatch.setattr(installation, "program_commit", lambda: commit)
    code = f", code {installation.code_digest()}" if has_code else ""
    assert installation.flown_program() == f"{text}{code})"
    assert installation.program_text() == f"{text})"
