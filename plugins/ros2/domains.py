"""Domains of ROS: one for each run of this machine, so that no two graphs meet."""

import errno
import socket
from collections.abc import Iterator
from contextlib import contextmanager

from wil_campaign.plugins.ros2.wire import WireError

_FIRST, _LAST = 1, 101
"""Domains whose ports are none that Linux gives to others."""
_BASE_PORT, _PORTS_OF_DOMAIN, _FIRST_UNICAST = 7400, 250, 10
_PARTICIPANTS = 8


@contextmanager
def claimed_domain(wanted: int | None) -> Iterator[int]:
    """Hold a domain of ROS that no other run holds. Raises WireError.

    wanted: None for one that no participant of DDS on this machine uses either.
    """
    candidates = range(_FIRST, _LAST + 1) if wanted is None else (wanted,)
    for domain in candidates:
        if wanted is None and _has_participants(domain):
            continue
        with socket.socket(socket.AF_UNIX) as claim:
            try:
                # An abstract name, which ends with this process.
                claim.bind(f"\0wil-campaign-ros-domain-{domain}")
            except OSError as error:
                if error.errno != errno.EADDRINUSE:
                    raise
                continue
            yield domain
            return
    if wanted is None:
        raise WireError(f"no domain of ROS is free: {_FIRST} to {_LAST} are in use")
    raise WireError(
        f"domain {wanted} of ROS is in use by another run: leave autonomy.ros2.domain out, or fly "
        "one run after the other"
    )


def _has_participants(domain: int) -> bool:
    """Return whether a port of the first participants of a domain is taken (DDSI-RTPS 9.6.1)."""
    first = _BASE_PORT + _PORTS_OF_DOMAIN * domain + _FIRST_UNICAST
    return any(_is_taken(first + 2 * index) for index in range(_PARTICIPANTS))


def _is_taken(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("", port))
        except OSError:
            return True
    return False
