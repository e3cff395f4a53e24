"""The program that runs here: its version, its commit, and what pip installs it from elsewhere."""

import hashlib
import json
import os
import re
import subprocess
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from wil_campaign.installed_plugins import third_party_modules, third_party_plugins

UNKNOWN_COMMIT = "unknown commit"
NOT_INSTALLED = "not installed"
_NAME = "wil-campaign"
_HOME = Path(__file__).parents[1]
"""Where the program's folders lie: wil_campaign, or the root of a checkout that lost its links."""
_PACKAGE = _HOME if (_HOME / "py.typed").is_file() else _HOME / "wil_campaign"
_FOLDERS = ("orchestrator", "vehicles", "recipes", "campaigns", "safety", "worlds", "plugins")
_FOLDERS_WITH_DATA, _DATA = ("vehicles", "plugins"), {".json", ".onnx", ".yaml"}
_DESCRIBE = ("describe", "--always", "--dirty", "--exclude=*", "--abbrev=40")
_GIT_S = 30.0
"""The longest that git may take, in seconds: the checkout may lie on a disk of the network."""
_COMMIT = re.compile(r"[0-9a-f]{40,64}")
_DESCRIBED = re.compile(rf"{_COMMIT.pattern}(-dirty)?")
_URL = re.compile(r"(https?|ssh)://[\w.@:/~+%,-]+", re.ASCII)
"""URLs that another machine may reach, of characters that mean nothing to a shell or a workflow."""
_SUBDIRECTORY = re.compile(r"[\w./-]+", re.ASCII)


def program_version() -> str:
    """Return the version of the installed distribution, NOT_INSTALLED without one."""
    found = _distribution()
    return NOT_INSTALLED if found is None else found.version


@cache
def program_commit() -> str:
    """Return the commit of the running code, 40 digits; "-dirty" is added to that of changed code.

    A wheel has it in wil_campaign/COMMIT, or pip has recorded it; of a checkout git knows it.
    Returns UNKNOWN_COMMIT otherwise.
    """
    return commit_of(_PACKAGE, _recorded_source())


def program_text() -> str:
    """Return version and commit in words."""
    return f"{program_version()} ({_commit_text()})"


def flown_program() -> str:
    """Return what identifies the code that flies, in words: version and commit.

    Where there is no commit, or the code differs from it, a digest of the code is added.
    """
    is_exact = _COMMIT.fullmatch(program_commit())
    return program_text() if is_exact else f"{program_text()[:-1]}, code {code_digest()})"


@cache
def code_digest() -> str:
    """Return a digest of the program's code: the same in a checkout and in a wheel of it.

    With the data that its vehicles and plugins fly by: profiles, parameters, networks.
    """
    own = [*_PACKAGE.glob("*.py"), *(_PACKAGE / "foundation").rglob("*.py")]
    files = {path.relative_to(_PACKAGE): path for path in own}
    for folder in _FOLDERS:
        files |= {path.relative_to(_HOME): path for path in (_HOME / folder).rglob("*.py")}
    for folder in _FOLDERS_WITH_DATA:
        paths = (path for path in (_HOME / folder).rglob("*") if path.suffix in _DATA)
        files |= {path.relative_to(_HOME): path for path in paths}
    return _digest_of(files)


def flown_plugins() -> dict[str, str]:
    """Return by name what identifies the plugins of others: distribution, version, code.

    One that is installed from a folder to be edited there keeps its version.
    """
    modules = third_party_modules()
    return {
        name: f"{origin}, code {_digest_of(_files_of_module(modules[name]))}"
        for name, origin in third_party_plugins().items()
    }


def _files_of_module(module: Any) -> dict[Path, Path]:
    """Return the Python files of a module or package, by their path in it."""
    file = getattr(module, "__file__", None)
    files = {} if file is None else {Path(Path(file).name): Path(file)}
    for folder in map(Path, getattr(module, "__path__", ())):
        files |= {path.relative_to(folder): path for path in folder.rglob("*.py")}
    return files


def _digest_of(files: Mapping[Path, Path]) -> str:
    """Return a short digest of files, by the names that count."""
    digest = hashlib.sha256()
    for name in sorted(files):
        digest.update(f"{name}\0".encode())
        digest.update(files[name].read_bytes())
    return digest.hexdigest()[:16]


def pip_requirement() -> str | None:
    """Return the requirement by which pip installs this very program on another machine.

    Returns None where it came from a folder or a file of this machine.
    """
    found = _distribution()
    if found is None or not _runs_from(found):
        return None
    recorded = _recorded_source()
    return f"{_NAME}=={found.version}" if recorded is None else requirement_of(recorded)


def requirement_of(recorded: Mapping[str, Any]) -> str | None:
    """Return the requirement for what a direct_url.json records, None for what is of one machine.

    Passwords and queries of URLs are left out: the requirement is written into a repository.
    """
    url, vcs, archive = (recorded.get(key) for key in ("url", "vcs_info", "archive_info"))
    public = _without_secrets(url) if isinstance(url, str) else ""
    if not _URL.fullmatch(public):
        return None
    if isinstance(vcs, dict):
        if vcs.get("vcs") != "git" or not _COMMIT.fullmatch(str(vcs.get("commit_id"))):
            return None
        folder = str(recorded.get("subdirectory") or "")
        below = f"#subdirectory={folder}" if _SUBDIRECTORY.fullmatch(folder) else ""
        return f"{_NAME} @ git+{public}@{vcs['commit_id']}{below}"
    if isinstance(archive, dict):
        hashes = archive.get("hashes")
        sha256 = str(hashes.get("sha256")) if isinstance(hashes, dict) else ""
        return f"{_NAME} @ {public}" + (f"#sha256={sha256}" if _COMMIT.fullmatch(sha256) else "")
    return None


def commit_of(package: Path, recorded: Mapping[str, Any] | None) -> str:
    """Return the commit of an installed package or one in a checkout; see `program_commit`.

    recorded: the package's direct_url.json, None without one.
    """
    with suppress(OSError, UnicodeDecodeError):
        built = (package / "COMMIT").read_text("utf-8").strip()
        if _DESCRIBED.fullmatch(built):
            return built
    vcs = (recorded or {}).get("vcs_info")
    cloned = str(vcs.get("commit_id")) if isinstance(vcs, dict) else ""
    return cloned if _COMMIT.fullmatch(cloned) else _commit_of_checkout(package.parent)


def _commit_of_checkout(root: Path) -> str:
    """Return the commit of a checkout of this project, UNKNOWN_COMMIT for any other folder."""
    try:
        is_ours = (root / ".git").exists() and f'name = "{_NAME}"' in (
            root / "pyproject.toml"
        ).read_text("utf-8")
        if not is_ours:
            return UNKNOWN_COMMIT
        # Under a hook of git, its variables name another repository. Another owner's checkout is
        # trusted: its code is what runs here.
        variables = {key: text for key, text in os.environ.items() if not key.startswith("GIT_")}
        done = subprocess.run(  # noqa: S603
            ("git", "-C", str(root), "-c", "safe.directory=*", *_DESCRIBE),  # noqa: S607
            env={**variables, "GIT_OPTIONAL_LOCKS": "0"},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=_GIT_S,
            check=False,
        )
    except (OSError, UnicodeDecodeError, subprocess.TimeoutExpired):
        return UNKNOWN_COMMIT
    found = done.stdout.strip()
    return found if _DESCRIBED.fullmatch(found) else UNKNOWN_COMMIT


def _commit_text() -> str:
    commit = program_commit()
    return commit if commit == UNKNOWN_COMMIT else f"commit {commit}"


def _distribution() -> Distribution | None:
    """Return the installed distribution of this name, whose code may be another than what runs."""
    try:
        return distribution(_NAME)
    except PackageNotFoundError:
        return None


def _runs_from(found: Distribution) -> bool:
    """Return whether the running code lies in the distribution's folder, not in a checkout."""
    return _PACKAGE.parent.resolve() == Path(str(found.locate_file(""))).resolve()


def _recorded_source() -> Mapping[str, Any] | None:
    """Return the direct_url.json of the running code; None without one: it came from an index."""
    found = _distribution()
    if found is None or not _runs_from(found):
        return None
    text = found.read_text("direct_url.json")
    if text is None:
        return None
    try:
        recorded = json.loads(text)
    except ValueError:
        recorded = None
    return recorded if isinstance(recorded, dict) else {}


def _without_secrets(url: str) -> str:
    """Return a URL without password, query and fragment; the user of ssh stays."""
    try:
        parts = urlsplit(url)
        host = parts.netloc.rpartition("@")[2]
        user = parts.username if parts.scheme == "ssh" else None
    except ValueError:
        return ""
    return parts._replace(netloc=f"{user}@{host}" if user else host, query="", fragment="").geturl()
