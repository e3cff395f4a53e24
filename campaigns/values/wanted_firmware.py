"""The firmware that `accept` requires of vehicles: a version, or the git hash of a build."""

import re
from collections.abc import Mapping

from wil_campaign.campaigns.values.acceptance import DECIDED

FIRMWARE = "firmware"
"""The key of `accept` for versions; with shares as values it is a case of that name."""
_VERSION = re.compile(r"[0-9]+(\.[0-9]+){0,2}(-[A-Za-z0-9]+)?")
_HASH = re.compile(r"[0-9a-f]{7,64}")


def names_versions(values: Mapping[str, str]) -> bool:
    """Return whether the values of a key of `accept` are versions, not shares of passes."""
    return bool(values) and not any("/" in value or value == DECIDED for value in values.values())


def check_firmware_version(text: str) -> None:
    """Raise ValueError, with the reason, for a text that is no version and no git hash."""
    if _VERSION.fullmatch(text) is None and _HASH.fullmatch(text) is None:
        raise ValueError(
            f"must be a version like 1.16 or 4.6.1, or at least 7 digits of a git hash, is '{text}'"
        )


def fits_firmware(wanted: str, version: str, git_hash: str) -> bool:
    """Return whether a vehicle runs the required firmware.

    wanted: "4.6" is any 4.6.x of whatever kind of release, "4.6.1" that release and not its
    "4.6.1-dev". version: as "4.6.1-rc". git_hash: of the build, which may be given by its first
    digits.
    """
    if version == wanted or (wanted.count(".") < 2 and version.startswith(f"{wanted}.")):
        return True
    return _HASH.fullmatch(wanted) is not None and git_hash.startswith(wanted)
