"""Names of files as a CI system knows them: within the repository of its job."""

import os
from pathlib import Path

_ROOTS = ("GITHUB_WORKSPACE", "CI_PROJECT_DIR")
"""Variables with the folder of the repository, of GitHub and GitLab."""


def repository_path(file: str) -> str | None:
    """Return a file's path within the repository of the job, else within the current folder.

    As it is where it is in neither. None for what is no file, as an option of the command line.
    """
    path = Path(file).absolute()
    if not path.exists():
        return None
    folders = [Path(os.environ[name]) for name in _ROOTS if os.environ.get(name)]
    for folder in (*folders, Path.cwd()):
        if path.is_relative_to(folder):
            return path.relative_to(folder).as_posix()
    return path.as_posix()
