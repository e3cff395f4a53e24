"""Where the journals of changed parameters are."""

import os
from pathlib import Path


def parameter_backup_folder() -> Path:
    """Return the folder of parameter backups; it outlives program and reboot."""
    state = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return Path(state) / "wil-campaign" / "parameters"
