"""The folder of parameter backups."""

import os
from pathlib import Path


def parameter_backup_folder() -> Path:
    """Return the folder of parameter backups; it outlives the program and a reboot."""
    state = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return Path(state) / "wil-campaign" / "parameters"
