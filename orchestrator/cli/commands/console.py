"""`wil-campaign console`: shows runs in flight, or a finished run, in the browser."""

import asyncio
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from orchestrator.cli.standard_streams import err, out
from orchestrator.console.console_address import ConsoleAddress
from orchestrator.console.console_process import ConsoleSettings, serve_console
from orchestrator.console.errors import ConsoleError
from orchestrator.foxglove_bridge.bridge_beside import foxglove_beside
from orchestrator.foxglove_bridge.errors import BridgeError
from orchestrator.recording.errors import RecordingError

_UNAVAILABLE = 3
_RECORDING = "run.mcap"
_SLOWEST, _FASTEST = 0.01, 100.0


def console(
    folder: Path | None = None,
    *,
    address: str = "127.0.0.1",
    tls_cert: Path | None = None,
    tls_key: Path | None = None,
    speed: float = 1.0,
    foxglove: str | None = None,
    beside: Annotated[int | None, Parameter(show=False)] = None,
) -> int:
    """Show the runs in flight on this machine in the browser, and take an operator's commands.

    It prints two links, each good for one browser: one for an operator, one for viewers. With the
    folder of a finished run it shows that run again. Ctrl-C ends the console and nothing else.

    Parameters
    ----------
    folder
        Only the campaign or run with this results folder; or the folder of a finished run.
    address
        HOST, HOST:PORT or :PORT; by default a free port of 127.0.0.1. Another host than this
        machine's own needs a certificate.
    tls_cert
        A certificate (PEM), with its chain.
    tls_key
        The certificate's key.
    speed
        The playback speed of a finished run; 1.0 is the speed of the flight.
    foxglove
        Send runs in flight live to Foxglove too: HOST, HOST:PORT or :PORT of loopback; auto for
        127.0.0.1:8765. It needs the extra foxglove.
    """
    if (tls_cert is None) != (tls_key is None):
        err("--tls-cert and --tls-key go together")
        return 2
    if not _SLOWEST <= speed <= _FASTEST:
        err(f"--speed is between {_SLOWEST} and {_FASTEST}")
        return 2
    recorded = _recorded(folder)
    if recorded is not None and foxglove is not None:
        err(f"--foxglove shows runs in flight only: open {recorded / _RECORDING} in Foxglove")
        return 2
    try:
        settings = ConsoleSettings(
            address=ConsoleAddress.parse(address),
            folder=folder,
            recorded=recorded,
            speed=speed,
            tls=None if tls_cert is None or tls_key is None else (tls_cert, tls_key),
        )
        with nullcontext() if foxglove is None else foxglove_beside(foxglove, out, folder=folder):
            asyncio.run(serve_console(settings, out, beside=beside))
    except BridgeError as error:
        err(error)
        return 2
    except (ConsoleError, RecordingError) as error:
        err(error)
        return _UNAVAILABLE
    return 0


def _recorded(folder: Path | None) -> Path | None:
    """Return the folder if it is of a finished run, else None."""
    if folder is None or not (folder / _RECORDING).is_file():
        return None
    return folder if (folder / "result.json").is_file() else None
