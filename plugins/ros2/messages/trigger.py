"""The service type std_srvs/Trigger: its name, its hash, and the CDR of its answers."""

import struct

TRIGGER = "std_srvs/srv/Trigger"
TRIGGER_HASH = "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f"
"""By REP 2016, as std_srvs of jazzy and kilted have it; rosbags hashes no services."""
_LITTLE_ENDIAN = b"\0\1\0\0"


def trigger_response(message: str, *, is_success: bool) -> bytes:
    """Return the CDR of a Trigger_Response."""
    text = message.encode() + b"\0"
    return _LITTLE_ENDIAN + struct.pack("<B3xI", is_success, len(text)) + text
