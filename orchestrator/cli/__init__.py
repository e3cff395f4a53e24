"""The command line: `wil-campaign`. Commands are imported when they are called, not before.

Exit code 2 is a fault that is found before anything is touched, 3 an internal error, 130 an
interrupt. Standard output carries only the requested result.
"""

import errno
import gc
import importlib
import os
import signal
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from cyclopts import App, CycloptsError, Group, MissingArgumentError, Parameter

from wil_campaign import hooks
from wil_campaign.hooks import Command, HelpSection
from wil_campaign.installed_plugins import (
    absent_additions,
    needed_plugin_text,
    plugin_additions,
    plugin_at_fault,
    plugin_that_adds,
    whose_fault_text,
)
from wil_campaign.orchestrator.cli.standard_streams import (
    StreamError,
    repair_standard_streams,
    widen_output,
    write_stderr,
)

USAGE_ERROR = 2
INTERNAL_ERROR = 3
INTERRUPTED = 130

_COMMANDS = (
    Command(
        "run",
        "wil_campaign.orchestrator.cli.commands.run:run",
        "Fly a campaign and write its verdicts.",
        "fly",
        flies=True,
    ),
    Command(
        "validate",
        "wil_campaign.orchestrator.cli.commands.validate:validate",
        "Report every fault of the files; nothing flies.",
        "start",
    ),
    Command(
        "judge",
        "wil_campaign.orchestrator.cli.commands.judge:judge",
        "Judge recorded runs again; nothing flies.",
        "look",
    ),
    Command(
        "report",
        "wil_campaign.orchestrator.cli.commands.report:report",
        "Write the HTML report of a flown campaign.",
        "look",
    ),
    Command(
        "abort",
        "wil_campaign.orchestrator.cli.commands.operate:abort",
        "Land all vehicles of a campaign at once; with --all, of every one.",
        "operate",
    ),
    Command(
        "hold",
        "wil_campaign.orchestrator.cli.commands.operate:hold",
        "Have a campaign's vehicles stop and hold their position.",
        "operate",
    ),
    Command(
        "resume",
        "wil_campaign.orchestrator.cli.commands.operate:resume",
        "Resume after a hold.",
        "operate",
    ),
)
"""The commands of the core; those of plugins come by `hooks.commands`."""
_TITLES: Mapping[HelpSection, str] = {
    "start": "Start: a campaign, and what it needs",
    "fly": "Fly",
    "look": "Look at what was flown",
    "operate": "Operate what flies",
}
_SECTIONS = {
    section: Group(title, sort_key=place) for place, (section, title) in enumerate(_TITLES.items())
}
_OWN = Group("Options", sort_key=len(_TITLES))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line (None: that of the process) and return its exit code.

    Every error is reported as a sentence; its traceback goes to a file, or to standard error with
    WIL_DEBUG=1.
    """
    tokens = list(sys.argv[1:] if arguments is None else arguments)
    repair_standard_streams()
    widen_output()
    try:
        with _interruptible():
            return _call_command(tokens)
    except SystemExit as error:
        # The parser's, also for Ctrl-C. Any other, as of a plugin, says nothing of what was flown.
        code = error.code
        if code == INTERRUPTED:
            write_stderr("interrupted")
        return code if code in (USAGE_ERROR, INTERRUPTED) else _report_failure(error)
    except KeyboardInterrupt:
        write_stderr("interrupted")
        return INTERRUPTED
    except BrokenPipeError:
        return INTERNAL_ERROR  # the reader of standard output has closed it
    except StreamError as error:
        write_stderr(error)
        return INTERNAL_ERROR
    except BaseException as error:  # noqa: BLE001 - nothing above this reports it
        return _report_failure(error)


def _call_command(tokens: list[str]) -> int:
    """Run the command of the command line's tokens; return the exit code."""
    commands = _commands_for(tokens)
    app = build_app(commands)
    if not tokens:
        app.help_print(console=app.error_console)
        return USAGE_ERROR
    command = commands.get(tokens[0])
    if command is None and tokens[0] in (missing := absent_additions(hooks.commands)):
        write_stderr(missing[tokens[0]])
        return USAGE_ERROR
    if command is not None and command.flies and not {*app.help_flags} & {*tokens}:
        _start_run_server()
    _import_module(command)
    code: object = app(tokens, result_action="return_value")
    if code is None:
        return 0
    # True would be a failure, and text a success.
    if isinstance(code, bool) or not isinstance(code, int):
        whose = whose_fault_text(plugin_that_adds(hooks.commands, tokens[0]))
        raise TypeError(f"command {tokens[0]} returned {code!r}, which is no exit code{whose}")
    return code


def all_commands() -> Mapping[str, Command]:
    """Return the commands by name: the core's, then those of plugins. Raises BadInput."""
    own = {command.name: command for command in _COMMANDS}
    return {**own, **plugin_additions(hooks.commands, own)}


def _commands_for(tokens: Sequence[str]) -> Mapping[str, Command]:
    """Return the commands; without plugins where one cannot be used, and vehicles are to land.

    Raises BadInput for a plugin that cannot be used where another command is wanted.
    """
    own = {command.name: command for command in _COMMANDS if command.section == "operate"}
    try:
        return all_commands()
    except Exception as error:
        if not tokens or tokens[0] not in own:
            raise
        write_stderr(error)
        return own


def _start_run_server() -> None:
    """Start the run server. Where it cannot, the command says so once it has read its input."""
    from wil_campaign.orchestrator.campaign.workers.run_server import (  # noqa: PLC0415 - one flies
        start_run_server,
    )
    from wil_campaign.safety.guard.process.runtime_folder import RuntimeFolderError  # noqa: PLC0415

    with suppress(RuntimeFolderError, OSError):
        start_run_server()


def _import_module(command: Command | None) -> None:
    """Import the module of a command, with garbage collection disabled.

    Imported objects stay: collections that scan them repeatedly take a sixth of the time.
    """
    if command is None or not command.function:
        return
    module = command.function.partition(":")[0]
    collects = gc.isenabled()
    gc.disable()
    try:
        importlib.import_module(module)
    except Exception as error:
        if plugin := plugin_that_adds(hooks.commands, command.name):
            error.add_note(f"(command {command.name}){whose_fault_text(plugin)}")
        raise
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


def build_app(commands: Mapping[str, Command] | None = None) -> App:
    """Return the command-line program, none of its commands imported yet. None: all of them."""
    app = App(
        name="wil-campaign",
        help="World-in-the-loop testing: a real vehicle and its twin fly one test together.",
        version=_version,
        help_format="plaintext",
        error_formatter=_usage_error,
        default_parameter=Parameter(negative=()),
    )
    for flag in (*app.help_flags, *app.version_flags):
        app[flag].group = _OWN
    groups: dict[str, App] = {}
    for name, command in (all_commands() if commands is None else commands).items():
        group, _, inner = name.rpartition(" ")
        section = None if group else _SECTIONS[command.section]
        if command.function:
            parent = groups.get(group, app)
            parent.command(command.function, name=inner, help=command.summary, group=section)
        else:
            groups[name] = App(name=name, help=command.summary, group=section)
            app.command(groups[name])
    return app


def _usage_error(error: CycloptsError) -> object:
    """Return what is wrong with a command line, and where its help is, as rich prints it."""
    from rich.text import Text  # noqa: PLC0415 - not needed for a command line without a fault

    command = " ".join(("wil-campaign", *(error.command_chain or ())))
    text = str(error)
    # An option that has no value is named as it was given, and has a keyword.
    if isinstance(error, MissingArgumentError) and error.argument and not error.keyword:
        name = error.argument.name
        is_place = error.argument.field_info.is_positional
        text = f"{command} needs {name.removeprefix('--').upper() if is_place else name}."
    return Text(f"{text}\nnext: {command} --help")


def _version() -> str:
    """Return the program's version and commit for the command line."""
    from wil_campaign.orchestrator.installation import (  # noqa: PLC0415 - slow, rarely used
        program_text,
    )

    return program_text()


def _long_path_text(error: BaseException) -> str:
    if not isinstance(error, OSError) or error.errno != errno.ENAMETOOLONG:
        return ""
    return f"'{str(error.filename)[:60]}...': is too long for a path"


def _is_nowhere() -> bool:
    """Return whether the current folder was removed."""
    try:
        Path.cwd()
    except FileNotFoundError:
        return True
    return False


def _report_failure(error: BaseException) -> int:
    """Print an error of the input or of the program on standard error; return the exit code.

    None where the reader of standard output has closed it: then Rich ends the program.
    """
    if isinstance(error, SystemExit) and isinstance(error.__context__, BrokenPipeError):
        return INTERNAL_ERROR
    import tempfile  # noqa: PLC0415 - not needed for --help
    import traceback  # noqa: PLC0415 - not needed for --help

    from wil_campaign.foundation.files.documents import BadInput  # noqa: PLC0415
    from wil_campaign.safety.guard.process.runtime_folder import RuntimeFolderError  # noqa: PLC0415

    if isinstance(error, BadInput | RuntimeFolderError):
        write_stderr(error)
        if isinstance(error, BadInput):
            from wil_campaign.orchestrator.cli.announcements import (  # noqa: PLC0415
                announce_problems,
            )

            announce_problems(error.problems, error.warnings)
        return USAGE_ERROR
    if text := _long_path_text(error) or needed_plugin_text("this command", error):
        write_stderr(text)
        return USAGE_ERROR
    if isinstance(error, FileNotFoundError) and _is_nowhere():
        write_stderr("the current folder was removed: change to one that exists (cd)")
        return INTERNAL_ERROR
    trace = "".join(traceback.format_exception(error))
    if os.environ.get("WIL_DEBUG") == "1":
        write_stderr(trace.rstrip())
        return INTERNAL_ERROR
    notes = getattr(error, "__notes__", ())
    message = " ".join([f"internal error: {type(error).__name__}: {error}", *notes])
    with suppress(BadInput):  # of a plugin that cannot be used
        plugin = plugin_at_fault(error)
        message += "" if plugin in message else whose_fault_text(plugin)
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="wil-campaign-", suffix=".log", delete=False, encoding="utf-8"
        ) as log:
            log.write(trace)
        message += f"\nthe traceback is in {log.name}; WIL_DEBUG=1 shows it here"
    except OSError as unwritable:
        message += f"\nno traceback could be written ({unwritable}); WIL_DEBUG=1 shows it here"
    write_stderr(message)
    return INTERNAL_ERROR
