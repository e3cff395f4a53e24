"""campaign.json: what was flown, with what, and where."""

import hashlib
import json
import os
import platform
import time
from collections import Counter
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from campaigns.expansion.expansion import Campaign
from campaigns.setup.case_files import CaseFiles
from orchestrator.campaign.folder.imported_files import imported_by
from orchestrator.campaign.folder.named_files import named_files
from orchestrator.model.clock import Clock
from orchestrator.recording.timestamps import utc_text
from worlds.files.documents import Data

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


def judging_manifest(campaign: Campaign, flown: Mapping[str, Any]) -> dict[str, Any]:
    """Return that of a campaign's manifest by which its recorded runs are judged.

    Without the users' Python files, of which the judging uses nothing. flown: the manifest of the
    flight; runs whose documents differ from it in `repetitions` alone have the digest that it has.
    """
    files = {path for path in _files(campaign) if path.suffix != ".py"}
    return {
        "options": {"set": list(campaign.options.sets)},
        "versions": _versions(frozenset()),
        "files": _digests(files, campaign),
        "runs": _as_flown(campaign, flown),
        "document": campaign.document.data,
    }


def _as_flown(campaign: Campaign, flown: Mapping[str, Any]) -> list[dict[str, object]]:
    """Return the manifest's runs, by the repetitions of the flight where else nothing differs.

    These are in the campaign's document; of an option, or of a part of the campaign, the runs of a
    case and mode were as many.
    """
    before = of_runs(flown, "documents")
    counts = Counter(name.rpartition("/")[0] for name in before)
    document = flown.get("document")
    stated = document.get("repetitions") if isinstance(document, dict) else None
    given = [*([] if stated is None else [stated]), *set(counts.values())]
    as_then = {
        case: {_documents_digest(files, repetitions=one) for one in given}
        for case, files in _first_files(campaign).items()
    }
    return [
        {**run, "documents": before[plan.name]}
        if before.get(plan.name) in as_then[plan.case]
        else run
        for plan, run in zip(campaign.plans, _runs(campaign), strict=True)
    ]


def of_runs(manifest: Mapping[str, Any], key: str) -> dict[str, str]:
    """Return what a manifest states of its runs under a key, by their names; damage left out."""
    runs = manifest.get("runs")
    entries = runs if isinstance(runs, list) else []
    stated = ((one.get("run"), one.get(key)) for one in entries if isinstance(one, dict))
    return {run: value for run, value in stated if isinstance(run, str) and isinstance(value, str)}


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
    digests = {case: _documents_digest(files) for case, files in _first_files(campaign).items()}
    plans = campaign.plans
    # Runs share their files, but for those whose world draws speeds by the seed of each run.
    files = {id(run.files): run.files for run in plans}
    worlds = {key: world_digest(one) for key, one in files.items()}
    return [
        {
            "run": run.name,
            "seed": run.seed,
            "required": run.required,
            "documents": digests[run.case],
            "world": worlds[id(run.files)],
        }
        for run in plans
    ]


def _files_by_case(campaign: Campaign) -> dict[str, CaseFiles]:
    """Return the files of each case and control of a campaign for its manifest."""
    return {run.case: run.files for run in campaign.plans}


def _first_files(campaign: Campaign) -> dict[str, CaseFiles]:
    """Return for the manifest the files of the first run of each case and control.

    Those of the others differ from them in the seed of a world alone.
    """
    return {run.case: run.files for run in reversed(campaign.plans)}


def _documents_digest(files: CaseFiles, **changed: Data) -> str:
    """Return a digest of a case's documents for the manifest; changed: keys of the campaign."""
    own = files.campaign.data
    if isinstance(own, dict):
        own = {**own, **changed}
    beside = [None if one is None else one.data for one in (files.world, files.recipe)]
    text = json.dumps([own, *beside], sort_keys=True, default=str)
    return f"sha256:{hashlib.sha256(text.encode()).hexdigest()}"


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
