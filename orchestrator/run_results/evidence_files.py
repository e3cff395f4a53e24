"""The files on which a run's verdict rests, and whether they are those of its flight."""

import hashlib
from collections.abc import Mapping
from pathlib import Path

from wil_campaign.foundation.files.paths import open_at_once

EVIDENCE_FILES = ("judged.msgpack", "log.jsonl", "trajectory.csv")


def evidence_digests(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of each evidence file in a run's folder that can be read."""
    found = {}
    for name in EVIDENCE_FILES:
        try:
            with open_at_once(folder / name) as stream:
                found[name] = f"sha256:{hashlib.file_digest(stream, 'sha256').hexdigest()}"
        except OSError:  # whoever needs the file says that it is missing
            continue
    return found


def foreign_files(folder: Path, written: Mapping[str, str]) -> list[str]:
    """Return in a sentence each evidence file that is not as its flight wrote it.

    written: `evidence_files` of the run's result; empty in results of earlier versions.
    """
    present = evidence_digests(folder) if written else {}
    return [
        f"{name} is not that of this flight: it was damaged, changed or cut, or is of another run"
        for name, digest in present.items()
        if written.get(name) != digest
    ]
