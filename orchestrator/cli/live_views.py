"""Live views beside a flight, which plugins add."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from wil_campaign.hooks import LiveViewError, live_views
from wil_campaign.installed_plugins import absent, added, load
from wil_campaign.orchestrator.cli.plugin_options import PluginOptions, given


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
    Raises LiveViewError.
    """
    known, missing = added(live_views), absent(live_views)
    with ExitStack() as stack:
        for name, address in given(views).items():
            if name in missing:
                raise AbsentViewError(missing[name])
            view = load(known[name].beside)(address, say, folder=folder, program=program)
            stack.enter_context(view)
        yield


class AbsentViewError(LiveViewError):
    """A live view of a plugin that is not installed."""

    code = 2
