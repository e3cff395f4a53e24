"""The remedies of network socket errors, for the messages of links."""

import errno
import socket

from wil_campaign.vehicles.links.link_strings import LinkAddress

_FIRST_FREE_PORT = 1024
"""Lower ones are the system's."""


def socket_remedy(error: OSError, address: LinkAddress) -> str:
    """Return in words what a network socket's error at an address means, and what to do."""
    host, port = address.host, address.port
    if isinstance(error, socket.gaierror):
        return f"host {host!r} is unknown; check its name, or give its IP address"
    not_permitted = f"no permission for port {port}; choose one above 1023"
    if port >= _FIRST_FREE_PORT:
        not_permitted = f"no permission for port {port} of {host}; check this machine's firewall"
    remedies = {
        errno.ECONNREFUSED: f"nothing listens on port {port} of {host}; is the vehicle running, "
        "and is the port right?",
        errno.EHOSTUNREACH: f"{host} cannot be reached; check network and address",
        errno.ENETUNREACH: f"there is no route to {host}; check cable, WLAN and address",
        errno.EADDRINUSE: f"port {port} is in use by another program (a ground station, or an "
        "orphaned run); end that program, or choose another port",
        errno.EADDRNOTAVAIL: f"{host} is not an address of this machine; 0.0.0.0 listens on all of "
        "them",
        errno.EACCES: not_permitted,
        errno.EPERM: not_permitted,
    }
    text = f"{error.strerror or error}; check the network and the address"
    return remedies.get(error.errno or 0, text)
