"""Live views beside a flight, which plugins add."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from types import TracebackType

from wil_campaign.hooks import LiveViewError, live_views
from wil_campaign.installed_plugins import (
    absent_additions,
    installed_plugins_by_name,
    load_plugin_object,
    plugin_additions,
)
from wil_campaign.orchestrator.cli.plugin_options import PluginOptions, given_options

Raised = type[BaseException] | None


@contextmanager
def views_beside(
    views: PluginOptions,
    say: Callable[[str], None],
    *,
    folder: Path | None = None,
    program: int | None = None,
) -> Iterator[None]:
    """Open the live views that a user wants until the context is left. say: receives their lines.

    folder: only of campaigns that write there; program: only of the campaign of that process.
    A view that fails to close is reported by `say`: results are not lost with it. Raises
    LiveViewError, also for any other exception of a view that is opened.
    """
    known, missing = plugin_additions(live_views), absent_additions(live_views)
    with ExitStack() as stack:
        for name, address in given_options(views).items():
            if name in missing:
                raise AbsentViewError(missing[name])
            try:
                view = load_plugin_object(known[name].beside)(
                    address, say, folder=folder, program=program
                )
                view.__enter__()
            except LiveViewError:
                raise
            except (Exception, SystemExit) as fault:
                raise BrokenViewError(_broken_text(name, fault)) from fault
            stack.push(_closing(name, view, say))
        yield


def _closing(
    name: str, view: AbstractContextManager[object], say: Callable[[str], None]
) -> Callable[[Raised, BaseException | None, TracebackType | None], bool]:
    """Return what closes a live view; it hides no exception of the flight, and raises none."""

    def close(kind: Raised, error: BaseException | None, trace: TracebackType | None) -> bool:
        try:
            view.__exit__(kind, error, trace)
        except (Exception, SystemExit) as fault:  # noqa: BLE001 - of a plugin, after the flight
            say(f"--{name}: the view cannot be closed: {type(fault).__name__}: {fault}")
        return False

    return close


def _broken_text(name: str, fault: BaseException) -> str:
    """Return which plugin's view cannot be opened, and why."""
    plugins = (
        one for one in installed_plugins_by_name() if name in one.adds.get(live_views.__name__, ())
    )
    whose = next((f" of the plugin {one.name} ({one.origin})" for one in plugins), "")
    return (
        f"--{name}: the view{whose} cannot be opened: {type(fault).__name__}: {fault}; mend it, or "
        f"leave --{name} out"
    )


class AbsentViewError(LiveViewError):
    """A live view of a plugin that is not installed."""

    code = 2


class BrokenViewError(LiveViewError):
    """A live view whose plugin raises what is no LiveViewError, before anything flies."""

    code = 2
