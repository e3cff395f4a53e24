"""The command line: `wil-campaign`. Commands are imported when they are called, not before.

Exit code 2 is a fault that is found before anything is touched, 3 an internal error, 130 an
interrupt. Standard output carries only the requested result.
"""

import gc
import importlib
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from cyclopts import App, Parameter

from orchestrator.cli.standard_streams import StreamError, err, repair_standard_streams

USAGE_ERROR = 2
INTERNAL_ERROR = 3
INTERRUPTED = 130

_COMMANDS = (
    (
        "init",
        "orchestrator.cli.commands.init:init",
        "Write a campaign that is ready to fly, as a starting point.",
    ),
    ("run", "orchestrator.cli.commands.run:run", "Fly a campaign and write its verdicts."),
    (
        "search",
        "orchestrator.cli.commands.search:search",
        "Look for variants of a campaign that fail, confirm and reduce them.",
    ),
    (
        "validate",
        "orchestrator.cli.commands.validate:validate",
        "Report every fault of the files; nothing flies.",
    ),
    (
        "schema",
        "orchestrator.cli.commands.schema:schema",
        "Write JSON Schemas of the files, for editors.",
    ),
    ("plan", "orchestrator.cli.commands.plan:plan", "Show the runs of a campaign; nothing flies."),
    ("judge", "orchestrator.cli.commands.judge:judge", "Judge recorded runs again; nothing flies."),
    (
        "report",
        "orchestrator.cli.commands.report:report",
        "Write the HTML report of a flown campaign.",
    ),
    (
        "gap",
        "orchestrator.cli.commands.gap:gap",
        "Print pass rates by mode and the gap between them and reality.",
    ),
    (
        "compare",
        "orchestrator.cli.commands.compare:compare",
        "Report whether a case became worse since earlier flights.",
    ),
    (
        "history",
        "orchestrator.cli.commands.history:history",
        "Show pass rates, margins and durations of campaigns over time.",
    ),
    (
        "abort",
        "orchestrator.cli.commands.operate:abort",
        "Land all vehicles of this machine's campaigns at once.",
    ),
    (
        "hold",
        "orchestrator.cli.commands.operate:hold",
        "Have all vehicles stop and hold their position.",
    ),
    ("resume", "orchestrator.cli.commands.operate:resume", "Resume after a hold."),
    (
        "fence",
        "orchestrator.cli.commands.fence:fence",
        "Send new fences to the vehicles in flight.",
    ),
    (
        "sign",
        "orchestrator.cli.commands.sign:sign",
        "Sign an operator's command for MQTT.",
    ),
    (
        "watch",
        "orchestrator.cli.commands.watch:watch",
        "Show the runs in flight on this machine until they end.",
    ),
    (
        "console",
        "orchestrator.cli.commands.console:console",
        "Show runs in flight, or a finished run, in the browser.",
    ),
    ("mix", "orchestrator.cli.commands.mix:mix", "Mix images, videos or recordings by a recipe."),
    (
        "replay",
        "orchestrator.cli.commands.replay:replay_run",
        "Mix a recorded run again; nothing flies.",
    ),
    (
        "calibrate",
        "orchestrator.cli.commands.calibrate:calibrate",
        "Calibrate a real camera with a board.",
    ),
    (
        "vehicle",
        "orchestrator.cli.commands.vehicle:vehicle",
        "Fly an embedded PX4 or ArduCopter alone, for other programs.",
    ),
    ("bench", "", "Check files of benches, and serve one to a cluster."),
    (
        "doctor",
        "orchestrator.cli.commands.doctor:doctor",
        "Check this machine: programs, ports, permissions.",
    ),
    (
        "list",
        "orchestrator.cli.commands.listing:list_available",
        "List campaigns, operators, autonomies, oracles and signals.",
    ),
)

_BENCH_COMMANDS = (
    (
        "check",
        "orchestrator.cli.commands.bench:check",
        "Report every fault of bench files; nothing is connected to.",
    ),
    (
        "serve",
        "orchestrator.cli.commands.bench:serve",
        "Join a cluster, and fly its campaigns on a bench of this machine.",
    ),
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line (None: that of the process) and return its exit code.

    Every error is reported as a sentence; its traceback goes to a file, or to standard error with
    WIL_DEBUG=1.
    """
    tokens = list(sys.argv[1:] if arguments is None else arguments)
    repair_standard_streams()
    try:
        with _interruptible():
            return _call_command(tokens)
    except SystemExit as error:
        return error.code if isinstance(error.code, int) else int(error.code is not None)
    except KeyboardInterrupt:
        err("interrupted")
        return INTERRUPTED
    except BrokenPipeError:
        return INTERNAL_ERROR  # the reader of standard output has closed it
    except StreamError as error:
        err(error)
        return INTERNAL_ERROR
    except BaseException as error:  # noqa: BLE001 - nothing above this reports it
        return _report_failure(error)


def _call_command(tokens: list[str]) -> int:
    """Run the command of the command line's tokens; return the exit code."""
    app = build_app()
    if not tokens:
        app.help_print(console=app.error_console)
        return USAGE_ERROR
    _import_command(tokens)
    code = app(tokens, result_action="return_value")
    return code if isinstance(code, int) else 0


def _import_command(tokens: Sequence[str]) -> None:
    """Import the module of the command that the tokens name, with garbage collection disabled.

    Imported objects stay: collections that scan them repeatedly take a sixth of the time.
    """
    commands = {name: function for name, function, _ in _COMMANDS}
    module = commands.get(tokens[0], "").partition(":")[0]
    if not module:
        return
    collects = gc.isenabled()
    gc.disable()
    try:
        importlib.import_module(module)
    finally:
        gc.freeze()
        if collects:
            gc.enable()


@contextmanager
def _interruptible() -> Iterator[None]:
    """Handle SIGTERM, and SIGHUP unless ignored (nohup), as Ctrl-C on the command line."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    for number, handler in before.items():
        if handler is not signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def build_app() -> App:
    """Return the command-line program with its commands, none of them imported yet."""
    app = App(
        name="wil-campaign",
        help="World-in-the-loop testing: a real vehicle and its twin fly one test together.",
        version=_version,
        help_format="plaintext",
        default_parameter=Parameter(negative=()),
    )
    for name, function, summary in _COMMANDS:
        if function:
            app.command(function, name=name, help=summary)
        else:
            app.command(_bench_app(name, summary))
    return app


def _bench_app(name: str, summary: str) -> App:
    """Return the command `bench`, which has commands of its own."""
    app = App(name=name, help=summary)
    for inner, function, text in _BENCH_COMMANDS:
        app.command(function, name=inner, help=text)
    return app


def _version() -> str:
    """Return the program's version for the command line."""
    from importlib.metadata import PackageNotFoundError, version  # noqa: PLC0415 - slow, rarely used

    try:
        return version("wil-campaign")
    except PackageNotFoundError:
        return "not installed"


def _report_failure(error: BaseException) -> int:
    """Print an error of the input or of the program on standard error; return the exit code."""
    import tempfile  # noqa: PLC0415 - not needed for --help
    import traceback  # noqa: PLC0415 - not needed for --help

    from worlds.files.documents import BadInput  # noqa: PLC0415 - not needed for --help

    if isinstance(error, BadInput):
        err(error)
        return USAGE_ERROR
    trace = "".join(traceback.format_exception(error))
    if os.environ.get("WIL_DEBUG") == "1":
        err(trace.rstrip())
        return INTERNAL_ERROR
    message = f"internal error: {type(error).__name__}: {error}"
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="wil-campaign-", suffix=".log", delete=False, encoding="utf-8"
        ) as log:
            log.write(trace)
        message += f"\nthe traceback is in {log.name}; WIL_DEBUG=1 shows it here"
    except OSError as unwritable:
        message += f"\nno traceback could be written ({unwritable}); WIL_DEBUG=1 shows it here"
    err(message)
    return INTERNAL_ERROR
