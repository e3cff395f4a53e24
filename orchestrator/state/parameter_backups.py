"""Where the journals of changed parameters are."""

import os
from pathlib import Path


def parameter_backup_folder() -> Path:
    """Return where journals of changed parameters outlive this program, and the machine's sleep."""
    state = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return Path(state) / "wil-campaign" / "parameters"
