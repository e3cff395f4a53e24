"""`wil-campaign console`: shows runs in flight, or a finished run, in the browser."""

import asyncio
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from wil_campaign.hooks import LiveViewError, live_views
from wil_campaign.orchestrator.cli.live_views import views_beside
from wil_campaign.orchestrator.cli.plugin_options import (
    NO_OPTIONS,
    PluginOptions,
    given_options,
    takes_options,
)
from wil_campaign.orchestrator.cli.standard_streams import write_stderr, write_stdout
from wil_campaign.orchestrator.recording.errors import RecordingError
from wil_campaign.plugins.console.console_address import ConsoleAddress
from wil_campaign.plugins.console.console_process import ConsoleSettings, serve_console
from wil_campaign.plugins.console.playback import FASTEST, SLOWEST

_UNAVAILABLE = 3
_RECORDING = "run.mcap"


@takes_options(live_views, "views", str | None, but="console")
def console(
    folder: Path | None = None,
    *,
    address: str = "127.0.0.1",
    tls_cert: Path | None = None,
    tls_key: Path | None = None,
    speed: float | None = None,
    views: PluginOptions = NO_OPTIONS,
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
        The playback speed of a finished run; 1.0, the default, is that of the flight. The page
        changes it.
    """
    if (tls_cert is None) != (tls_key is None):
        write_stderr("--tls-cert and --tls-key go together")
        return 2
    recorded = _recorded(folder)
    if speed is not None and (fault := _speed_fault(speed, recorded)):
        write_stderr(fault)
        return 2
    if folder is not None and not folder.exists():
        write_stderr(f"there is no folder {folder} yet: the page waits for a flight in it")
    if recorded is not None and (wanted := next(iter(given_options(views)), "")):
        write_stderr(
            f"--{wanted} shows runs in flight only: open {recorded / _RECORDING} in Foxglove"
        )
        return 2
    try:
        settings = ConsoleSettings(
            address=ConsoleAddress.parse(address),
            folder=folder,
            recorded=recorded,
            speed=1.0 if speed is None else speed,
            tls=None if tls_cert is None or tls_key is None else (tls_cert, tls_key),
        )
        with views_beside(views, write_stdout, folder=folder):
            asyncio.run(serve_console(settings, write_stdout, beside=beside))
    except RecordingError as error:
        write_stderr(error)
        return _UNAVAILABLE
    except LiveViewError as error:
        write_stderr(error)
        return error.code
    return 0


def _speed_fault(speed: float, recorded: Path | None) -> str:
    """Return why a speed cannot be played at; "" if it can."""
    if not SLOWEST <= speed <= FASTEST:
        return f"--speed is between {SLOWEST} and {FASTEST}"
    if recorded is None:
        return "--speed is for a finished run: name its folder, as results/gate/START/large/wil/1"
    return ""


def _recorded(folder: Path | None) -> Path | None:
    """Return the folder if it is of a finished run, else None."""
    if folder is None or not (folder / _RECORDING).is_file():
        return None
    return folder if (folder / "result.json").is_file() else None
