"""The folder of parameter backups."""

import os
from pathlib import Path

from wil_campaign.foundation.files.own_folders import home_folder


class NoHomeError(OSError):
    """This user has no home folder; says what to do."""


def parameter_backup_folder() -> Path:
    """Return the folder of parameter backups; it outlives the program and a reboot.

    Raises NoHomeError.
    """
    if state := os.environ.get("XDG_STATE_HOME"):
        return Path(state) / "wil-campaign" / "parameters"
    home = home_folder()
    if home is None:
        raise NoHomeError(
            f"user {os.getuid()} has no home folder for the backups of an attached vehicle's "
            "parameters: set XDG_STATE_HOME to a folder that outlives a reboot"
        )
    return home / ".local" / "state" / "wil-campaign" / "parameters"
