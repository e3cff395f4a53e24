"""campaign.json: what was flown, with what, and where."""

import hashlib
import json
import os
import platform
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from campaigns.expansion.expansion import Campaign
from campaigns.setup.case_files import CaseFiles
from orchestrator.campaign.folder.imported_files import imported_by
from orchestrator.campaign.folder.named_files import named_files
from orchestrator.model.clock import Clock
from orchestrator.recording.timestamps import utc_text

_PIECE_BYTES = 1 << 20
_VERSIONED = (
    "wil-campaign",
    "av",
    "embreex",
    "jsbsim",
    "numba",
    "numpy",
    "opencv-python-headless",
    "pymavlink",
    "trimesh",
)
"""Packages whose version may change what a run does."""


def manifest(campaign: Campaign, clock: Clock, *, arm: bool = True) -> dict[str, object]:
    """Return the manifest campaign.json: what is flown, with what, where; arm: not --no-arm."""
    files = _files(campaign)
    imported = imported_by({path for path in files if path.suffix == ".py"})
    return {
        "campaign": campaign.name,
        "description": campaign.description,
        "seed": campaign.seed,
        "clock": clock,
        "arm": arm,
        "options": {
            "case": list(campaign.options.cases),
            "mode": list(campaign.options.modes),
            "set": list(campaign.options.sets),
        },
        "started_utc": utc_text(time.time()),
        "host": {"name": platform.node(), "machine": platform.machine(), "cores": os.cpu_count()},
        "versions": {"python": platform.python_version(), **_versions(imported.packages)},
        "files": _digests(files | imported.files, campaign),
        "runs": _runs(campaign),
        "document": campaign.document.data,
    }


def _digests(files: set[Path], campaign: Campaign) -> dict[str, str]:
    """Return for the manifest the SHA-256 of files, by their paths from the campaign's folder."""
    home = campaign.document.path.resolve().parent
    return {os.path.relpath(path, home): f"sha256:{_digest(path)}" for path in sorted(files)}


def judging_manifest(campaign: Campaign) -> dict[str, Any]:
    """Return that of a campaign's manifest by which its recorded runs are judged.

    Without the users' Python files, of which the judging uses nothing.
    """
    files = {path for path in _files(campaign) if path.suffix != ".py"}
    return {
        "options": {"set": list(campaign.options.sets)},
        "versions": _versions(frozenset()),
        "files": _digests(files, campaign),
        "runs": _runs(campaign),
        "document": campaign.document.data,
    }


def read_files(campaign: Campaign) -> set[Path]:
    """Return every file that a run of the campaign reads: those named, and what Python imports."""
    files = _files(campaign)
    return files | imported_by({path for path in files if path.suffix == ".py"}).files


def flown_versions() -> dict[str, str]:
    """Return the versions of the packages that may change what a run does."""
    return _versions(frozenset())


def _files(campaign: Campaign) -> set[Path]:
    """Return every file that the campaign reads or names.

    The campaign, its worlds and recipes, and what a text in one of them names beside it: the
    autonomy, profiles, meshes with what these name, steps, models, programs, firmware, pictures.
    """
    files = {path.resolve() for path in campaign.paths}
    for case in _files_by_case(campaign).values():
        for document in (case.campaign, case.world, case.recipe):
            if document is not None:
                files.update(named_files(document.data, document.path))
    return files


def _runs(campaign: Campaign) -> list[dict[str, object]]:
    """Return the manifest's runs; documents: a digest of all that a run reads, as overridden."""
    digests: dict[str, str] = {}
    for run in campaign.plans:
        if run.case not in digests:
            read = (run.files.campaign, run.files.world, run.files.recipe)
            plain = [None if one is None else one.data for one in read]
            text = json.dumps(plain, sort_keys=True, default=str)
            digests[run.case] = f"sha256:{hashlib.sha256(text.encode()).hexdigest()}"
    worlds = {case: world_digest(files) for case, files in _files_by_case(campaign).items()}
    return [
        {
            "run": run.name,
            "seed": run.seed,
            "required": run.required,
            "documents": digests[run.case],
            "world": worlds[run.case],
        }
        for run in campaign.plans
    ]


def _files_by_case(campaign: Campaign) -> dict[str, CaseFiles]:
    """Return the files of each case and control of a campaign for its manifest."""
    return {run.case: run.files for run in campaign.plans}


def world_digest(files: CaseFiles) -> str:
    """Return a digest of a case's world for the manifest: as overridden, with meshes it names."""
    if files.world is None:
        return ""
    digest = hashlib.sha256(json.dumps(files.world.data, sort_keys=True, default=str).encode())
    for path in named_files(files.world.data, files.world.path):
        _add_file(digest, path)
    return f"sha256:{digest.hexdigest()}"


def _digest(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal digits."""
    digest = hashlib.sha256()
    _add_file(digest, path)
    return digest.hexdigest()


def _add_file(digest: "hashlib._Hash", path: Path) -> None:
    """Add a file to a digest, in pieces: a video may be larger than the memory."""
    with path.open("rb") as stream:
        while piece := stream.read(_PIECE_BYTES):
            digest.update(piece)


def _versions(imported: frozenset[str]) -> dict[str, str]:
    """Return for the manifest the versions of the packages in use; imported: by users' files."""
    found: dict[str, str] = {}
    for name in (*_VERSIONED, *sorted(imported - set(_VERSIONED))):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found
