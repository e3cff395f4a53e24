"""What a wheel holds beside wil_campaign/: the top-level folders under that name, and the commit.

In a checkout wil_campaign/ has symbolic links to the folders. A wheel takes the folders themselves:
a checkout that came as a zip may have lost its links.
"""

import os
import subprocess
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

FOLDERS = ("orchestrator", "vehicles", "recipes", "campaigns", "safety", "worlds", "plugins")


class Hook(BuildHookInterface[Any]):
    """Adds the folders and the commit to a wheel, and the commit to an sdist."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Name what the archive holds. version: of the build: standard or editable."""
        root = Path(self.root)
        if version == "editable":
            return
        included = build_data["force_include"]
        is_wheel = self.target_name == "wheel"
        commit = root / "COMMIT"  # of an sdist
        if (root / ".git").exists():
            # Not into the checkout: a build that is killed would leave it to all later ones.
            self._scratch = commit = Path(mkdtemp()) / "COMMIT"
            commit.write_text(described(root), "utf-8")
        if commit.exists():
            included[str(commit)] = "wil_campaign/COMMIT" if is_wheel else "COMMIT"
        if is_wheel:
            included |= {str(root / name): f"wil_campaign/{name}" for name in self._files(root)}

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the file that was written for the archive."""
        del version, build_data, artifact_path
        made: Path | None = getattr(self, "_scratch", None)
        if made is not None:
            made.unlink(missing_ok=True)
            made.parent.rmdir()

    def _files(self, root: Path) -> Iterator[str]:
        """Yield the files of the folders, without what .gitignore names: results, caches."""
        for folder in FOLDERS:
            for path in sorted((root / folder).rglob("*")):
                name = path.relative_to(root).as_posix()
                if path.is_file() and not self.build_config.path_is_excluded(name):
                    yield name


def described(root: Path) -> str:
    """Return the commit of a checkout, with "-dirty" where its files differ; "" without git."""
    variables = {key: text for key, text in os.environ.items() if not key.startswith("GIT_")}
    words = ("describe", "--always", "--dirty", "--exclude=*", "--abbrev=40")
    with suppress(OSError):
        return subprocess.run(  # noqa: S603
            ("git", "-C", str(root), "-c", "safe.directory=*", *words),  # noqa: S607
            env=variables | {"GIT_OPTIONAL_LOCKS": "0"},
            capture_output=True,
            text=True,
            check=False,
        ).stdout
    return ""
