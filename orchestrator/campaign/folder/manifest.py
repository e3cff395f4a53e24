"""The manifest of a campaign, campaign.json: its runs, files, versions and machine."""

import hashlib
import json
import os
import platform
import time
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from wil_campaign.campaigns.expansion.expansion import Campaign
from wil_campaign.campaigns.setup.case_files import CaseFiles
from wil_campaign.foundation.clocks.virtual_loop import Clock
from wil_campaign.foundation.files.documents import Data, Document
from wil_campaign.foundation.files.problems import without_passwords
from wil_campaign.foundation.files.yaml_nodes import YamlNode, plain_value_of_node
from wil_campaign.foundation.processes.linux import usable_cores
from wil_campaign.hooks import autonomy_kinds
from wil_campaign.installed_plugins import plugin_additions
from wil_campaign.orchestrator.campaign.folder.imported_files import files_imported_by
from wil_campaign.orchestrator.campaign.folder.named_files import document_place, named_files
from wil_campaign.orchestrator.installation import flown_plugins, flown_program
from wil_campaign.orchestrator.recording.timestamps import utc_text

_CHUNK_BYTES = 1 << 20
_LOADED = frozenset({".py", ".onnx", ".so"})
_VERSIONED = (
    "av",
    "embreex",
    "jsbsim",
    "numba",
    "numpy",
    "opencv-python-headless",
    "pymavlink",
    "trimesh",
)
"""Packages whose version may change the flight of a run, as this program may."""


def campaign_manifest(campaign: Campaign, clock: Clock, *, arm: bool = True) -> dict[str, object]:
    """Return the content of campaign.json. arm: False for --no-arm."""
    files = _files(campaign)
    imported = files_imported_by({path for path in files if path.suffix == ".py"})
    return {
        "campaign": campaign.name,
        "file": campaign.document.path.name,
        "description": campaign.description,
        "seed": campaign.seed,
        "clock": clock,
        "arm": arm,
        "options": {
            "case": list(campaign.options.cases),
            "mode": list(campaign.options.modes),
            "set": _shown(list(campaign.options.sets)),
        },
        "started_utc": utc_text(time.time()),
        "host": {"name": platform.node(), "machine": platform.machine(), "cores": usable_cores()},
        "versions": {"python": platform.python_version(), **_versions(imported.packages)},
        "plugins": flown_plugins(),
        "files": _digests(files | imported.files, campaign),
        "runs": _runs(campaign),
        "requirements": [asdict(requirement) for requirement in campaign.requirements],
        "document": _shown(campaign.document.data),
    }


def _shown(data: Any) -> Any:
    """Return values as results have them: without the passwords of addresses."""
    return json.loads(without_passwords(json.dumps(data, default=str)))


def _digests(files: set[Path], campaign: Campaign) -> dict[str, str]:
    home = campaign.document.path.resolve().parent
    paths = sorted({path.resolve() for path in files})
    return {os.path.relpath(path, home): file_digest(path) for path in paths}


def judging_manifest(campaign: Campaign, flown: Mapping[str, Any]) -> dict[str, Any]:
    """Return the part of a campaign's manifest that affects how its recorded runs are judged.

    It excludes the users' Python files, which judging does not use. flown: the manifest of the
    flight; runs whose documents differ from it only in `repetitions` keep its digest.
    """
    files = {path for path in _files(campaign) if path.suffix != ".py"}
    return {
        "options": {"set": _shown(list(campaign.options.sets))},
        "versions": _versions(frozenset()),
        "plugins": flown_plugins(),
        "files": _digests(files, campaign),
        "runs": _as_flown(campaign, flown),
        "document": _shown(campaign.document.data),
    }


def _as_flown(campaign: Campaign, flown: Mapping[str, Any]) -> list[dict[str, object]]:
    """Return the manifest's runs, with the digest of the flight where only `repetitions` differs.

    The flight's number is in its campaign document, or, where an option or a part of the campaign
    set it, in the number of runs per case and mode.
    """
    before = manifest_run_values(flown, "documents")
    counts = Counter(name.rpartition("/")[0] for name in before)
    document = flown.get("document")
    stated = document.get("repetitions") if isinstance(document, dict) else None
    given = [*([] if stated is None else [stated]), *set(counts.values())]
    of_cases, texts = _first_files(campaign), dict[int, str]()
    as_then = {
        case: {_documents_digest(files, texts, repetitions=one) for one in given}
        for case, files in of_cases.items()
    }
    return [
        {**run, "documents": before[plan.name]}
        if before.get(plan.name) in as_then[plan.case]
        else run
        for plan, run in zip(campaign.plans, _runs(campaign), strict=True)
    ]


def manifest_run_values(manifest: Mapping[str, Any], key: str) -> dict[str, str]:
    """Return the values of a key of a manifest's runs, by run name, without damaged entries."""
    runs = manifest.get("runs")
    entries = runs if isinstance(runs, list) else []
    stated = ((entry.get("run"), entry.get(key)) for entry in entries if isinstance(entry, dict))
    return {run: value for run, value in stated if isinstance(run, str) and isinstance(value, str)}


def files_read_by_campaign(campaign: Campaign) -> set[Path]:
    """Return every file that the campaign's runs read, with imported Python modules.

    By the names by which the runs read them: symlinks are not followed.
    """
    files = _files(campaign)
    return files | files_imported_by({path for path in files if path.suffix == ".py"}).files


def flown_versions() -> dict[str, str]:
    """Return the versions of the packages that may change the flight of a run."""
    return _versions(frozenset())


def _files(campaign: Campaign) -> set[Path]:
    """Return every file that the campaign reads or names.

    These are the campaign, its worlds and recipes, and the files that they name: the autonomy,
    profiles, meshes with their textures, steps, models, programs, firmware, images.
    """
    files = {document_place(path) for path in campaign.paths}
    for document in naming_documents(campaign):
        files.update(named_files(document.data, document.path))
    return files


def maybe_written_files(campaign: Campaign) -> set[Path]:
    """Return the files that only the user's own code is given by name, except code and networks.

    They are named by `with`, and by the arguments of an autonomy that is a command line. A flight
    may read or write them.
    """
    files: set[Path] = set()
    kinds = frozenset(plugin_additions(autonomy_kinds))
    for document in naming_documents(campaign):
        for value in _given_to_code(document.data, kinds):
            files.update(named_files(value, document.path))
    return {path for path in files if path.suffix not in _LOADED}


def _given_to_code(data: Data, kinds: Collection[str]) -> Iterator[Data]:
    """Yield the values in a document that the user's own code is given as they are.

    kinds: keys of autonomies that are no class.
    """
    if isinstance(data, list):
        for inner in data:
            yield from _given_to_code(inner, kinds)
    elif isinstance(data, dict):
        for key, inner in data.items():
            if key == "with":
                yield inner
            elif key in kinds and isinstance(inner, list):
                yield inner[1:]
            else:
                yield from _given_to_code(inner, kinds)


def naming_documents(campaign: Campaign) -> Iterator[Document]:
    """Yield the documents of a campaign's cases that may name further files.

    A campaign file that lists many cases is whole once, and of the others without their list.
    """
    seen = set[Path]()
    for case in _files_by_case(campaign).values():
        whole = case.campaign.path not in seen
        seen.add(case.campaign.path)
        for document in (case.campaign if whole else case.of_case, case.world, case.recipe):
            if document is not None:
                yield document


def _runs(campaign: Campaign) -> list[dict[str, object]]:
    """Return the manifest's runs; documents: a digest of their documents with overrides."""
    of_cases, texts = _first_files(campaign), dict[int, str]()
    digests = {case: _documents_digest(files, texts) for case, files in of_cases.items()}
    plans = campaign.plans
    # Runs share their files, except where the world draws speeds by the seed of each run.
    files = {id(run.files): run.files for run in plans}
    worlds = {key: world_digest(file) for key, file in files.items()}
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
    return {run.case: run.files for run in campaign.plans}


def _first_files(campaign: Campaign) -> dict[str, CaseFiles]:
    """Return the files of the first run of each case and control.

    Those of the other runs differ only in the seed of their world.
    """
    return {run.case: run.files for run in reversed(campaign.plans)}


def _documents_digest(files: CaseFiles, texts: dict[int, str], **changed: Data) -> str:
    """Return a digest of a case's documents; changed: replaced keys of the campaign.

    texts: of the values that documents of several cases share, which are thousands in a large one.
    """
    own = files.campaign.root.value
    keys = {key: entry.node for key, entry in own.items()} if isinstance(own, dict) else {}
    parts = {key: _text_of_node(node, texts) for key, node in keys.items()}
    parts |= {key: json.dumps(value, sort_keys=True) for key, value in changed.items()}
    text = ", ".join(f"{json.dumps(key)}: {parts[key]}" for key in sorted(parts))
    beside = [
        "null" if document is None else _text_of_node(document.root, texts)
        for document in (files.world, files.recipe)
    ]
    digest = hashlib.sha256(f"[{{{text}}}, {', '.join(beside)}]".encode())
    return f"sha256:{digest.hexdigest()}"


def _text_of_node(node: YamlNode, texts: dict[int, str]) -> str:
    """Return a node as JSON with sorted keys; made once, as the node outlives `texts`."""
    if id(node) not in texts:
        text = json.dumps(plain_value_of_node(node), sort_keys=True, default=str)
        texts[id(node)] = without_passwords(text)
    return texts[id(node)]


def world_digest(files: CaseFiles) -> str:
    """Return a digest of a case's world, with overrides and the meshes that it names."""
    if files.world is None:
        return ""
    digest = hashlib.sha256(json.dumps(files.world.data, sort_keys=True, default=str).encode())
    for path in named_files(files.world.data, files.world.path):
        _add_file(digest, path)
    return f"sha256:{digest.hexdigest()}"


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file as a manifest has it. Raises OSError."""
    digest = hashlib.sha256()
    _add_file(digest, path)
    return f"sha256:{digest.hexdigest()}"


def _add_file(digest: "hashlib._Hash", path: Path) -> None:
    """Add a file to a digest, in chunks: a video may be larger than the memory."""
    with path.open("rb") as stream:
        while chunk := stream.read(_CHUNK_BYTES):
            digest.update(chunk)


def _versions(imported: frozenset[str]) -> dict[str, str]:
    """Return the versions of the packages in use; imported: by users' files."""
    versions = {"wil-campaign": flown_program()}
    for name in (*_VERSIONED, *sorted(imported - {*versions, *_VERSIONED})):
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "not installed"
    return versions
