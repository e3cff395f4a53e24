"""Opens serial ports of a POSIX system for raw bytes, with a remedy for each error."""

import errno
import fcntl
import grp
import os
import stat
import struct
import sys
import termios
from pathlib import Path

_TCGETS2, _TCSETS2 = 0x802C542A, 0x402C542B
_BOTHER, _CBAUD = 0o010000, 0o010017
_TERMIOS2 = struct.Struct("4IB19s2I")
"""Linux, asm-generic/ioctls.h and termbits.h: speeds that have no name."""
_USUAL_NAMES = ("ttyACM*", "ttyUSB*", "ttyAMA*", "cu.usb*")


def open_serial_port(device: str, baud: int) -> int:
    """Return the descriptor of a serial port: raw, 8N1, not blocking, exclusive.

    Raises OSError; `remedy` gives its message.
    """
    # Without O_NONBLOCK a port without carrier blocks for ever.
    port = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        # TIOCEXCL does not exclude root, and the lock only programs that lock.
        fcntl.flock(port, fcntl.LOCK_EX | fcntl.LOCK_NB)
        _make_raw(port, baud)
        fcntl.ioctl(port, termios.TIOCEXCL)
        termios.tcflush(port, termios.TCIOFLUSH)
    except termios.error as error:
        os.close(port)
        raise OSError(*error.args) from error
    except BaseException:
        os.close(port)
        raise
    return port


def likely_serial_ports() -> tuple[str, ...]:
    """Return the serial ports that look like an autopilot's or a radio's."""
    return tuple(sorted(str(path) for name in _USUAL_NAMES for path in Path("/dev").glob(name)))


def serial_port_remedy(error: OSError, device: str, baud: int) -> str:
    """Return in words why a serial port could not be opened, and what to do."""
    match error.errno:
        case errno.ENOENT | errno.ENODEV | errno.ENXIO:
            there = ", ".join(likely_serial_ports())
            return f"there is no {device}; " + (
                f"the serial ports are: {there}" if there else "no serial device is connected"
            )
        case errno.EACCES | errno.EPERM:
            group = serial_port_group(device)
            return (
                f"no permission for {device}; add yourself to its group ('sudo usermod -aG "
                f"{group} $USER') and log in again"
            )
        case errno.EBUSY | errno.EWOULDBLOCK:
            return (
                f"{device} is in use by another program (a ground station, ModemManager, or an "
                "orphaned run); end that program"
            )
        case errno.ENOTTY | errno.EISDIR:
            return f"{device} is not a serial port"
        case errno.EINVAL:
            return f"{device} does not support {baud} baud"
        case _:
            return f"{device}: {error.strerror or error}"


def _make_raw(port: int, baud: int) -> None:
    attributes = termios.tcgetattr(port)
    special = attributes[6]
    special[termios.VMIN], special[termios.VTIME] = 1, 0
    control = termios.CS8 | termios.CREAD | termios.CLOCAL
    named = getattr(termios, f"B{baud}", None)
    speed = termios.B9600 if named is None else named
    termios.tcsetattr(port, termios.TCSANOW, [0, 0, control, 0, speed, speed, special])
    if named is None:
        _set_unnamed_speed(port, baud)


def _set_unnamed_speed(port: int, baud: int) -> None:
    """Set a serial port's non-standard baud rate (Linux). Raises OSError."""
    if not sys.platform.startswith("linux"):
        raise OSError(errno.EINVAL, f"no such speed: {baud}")
    raw = fcntl.ioctl(port, _TCGETS2, bytes(_TERMIOS2.size))
    fields = list(_TERMIOS2.unpack(raw))
    fields[2] = fields[2] & ~_CBAUD | _BOTHER
    fields[-2:] = [baud, baud]
    fcntl.ioctl(port, _TCSETS2, _TERMIOS2.pack(*fields))


def serial_port_group(device: str) -> str:
    """Return the group that may open a serial port."""
    try:
        found = Path(device).stat()
        if stat.S_ISCHR(found.st_mode):
            return grp.getgrgid(found.st_gid).gr_name
    except (OSError, KeyError):
        pass
    return "dialout"
