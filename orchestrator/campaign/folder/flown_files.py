"""The files that the runs of a campaign read anew: they may not change while it flies."""

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from wil_campaign.orchestrator.campaign.folder.campaign_folder import OutputError
from wil_campaign.orchestrator.campaign.folder.manifest import file_digest
from wil_campaign.vehicles.embedded.profile import profile_files

_State = tuple[int, int, int]
"""Size, time of the last change and inode: where they are the same, the content is."""


@dataclass(frozen=True, slots=True)
class FlownFiles:
    """The files of a campaign, as its manifest has them. digests, states: by absolute path.

    home: the folder of the campaign file. named: digests by path relative to it, symlinks followed,
    with those of code that only runs have imported.
    """

    home: Path
    named: dict[str, str]
    digests: Mapping[Path, str]
    states: dict[Path, _State | None]

    @classmethod
    def of(
        cls,
        campaign_file: Path,
        digests: Mapping[str, str],
        *,
        read: Iterable[Path],
        skipped: Iterable[Path],
    ) -> Self:
        """Return the files of a manifest that was just made.

        digests: by path relative to the campaign file, symlinks followed. read: the files by the
        names by which runs read them, which may be symlinks. skipped: documents, of which runs have
        what was read when the campaign began, so that a later change of them concerns no run; and
        files that a flight may write. The program's own profiles are watched as well: each run
        reads them, and a checkout may be edited.
        """
        home = campaign_file.resolve().parent
        left_out = {path.resolve() for path in skipped}
        by_path = {Path(os.path.normpath(home / name)): text for name, text in digests.items()}
        places = {path: path.resolve() for path in read}
        own = {
            path: by_path[place]
            for path, place in places.items()
            if place in by_path and place not in left_out
        }
        own |= {path: file_digest(path) for path in profile_files()}
        return cls(home, dict(digests), own, {path: _state_of(path) for path in own})

    def require_same_code(self, run: str, code: Mapping[str, str]) -> None:
        """Raise OutputError where a run imported other code than the campaign or an earlier run.

        code: what it imported, by path relative to the campaign file.
        """
        for name, digest in code.items():
            if self.named.setdefault(name, digest) != digest:
                raise OutputError(
                    f"{self.home / name} changed while the campaign flew: {run} flew with it as it "
                    "is now, other runs with what it was before. No further run is flown: results "
                    "of two different campaigns must not be mixed. Start anew without --resume"
                )

    def require_code_on_disk(self, run: str, code: Mapping[str, str]) -> None:
        """Raise OutputError where code that a finished run imported is no longer what it was."""
        for name, digest in code.items():
            path = self.home / name
            if _digest_of(path) != digest:
                what = "changed" if path.exists() else "is missing"
                raise OutputError(
                    f"{path} {what} since {run} flew with it: results of two different campaigns "
                    "must not be mixed; undo the change, or start anew without --resume"
                )
            self.named.setdefault(name, digest)

    def require_unchanged(self) -> None:
        """Raise OutputError for a file whose content is no longer that of the manifest."""
        for path, digest in self.digests.items():
            state = _state_of(path)
            if state == self.states[path]:
                continue
            if _digest_of(path) != digest:
                raise OutputError(
                    f"{path} changed while the campaign flew, and no further run is flown: results "
                    "of two different campaigns must not be mixed. Runs flown so far are kept: "
                    "undo the change and use --resume, or start anew without --resume"
                )
            self.states[path] = state


def _state_of(path: Path) -> _State | None:
    """Return the state of a file; None where there is none."""
    try:
        facts = path.stat()
    except OSError:
        return None
    return facts.st_size, facts.st_mtime_ns, facts.st_ino


def _digest_of(path: Path) -> str:
    """Return the digest of a file; "" where it cannot be read."""
    try:
        return file_digest(path)
    except OSError:
        return ""
