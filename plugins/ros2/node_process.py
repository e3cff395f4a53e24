"""The process of a node: started with a run, with its own log, and ended with it."""

import os
import time
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path

from wil_campaign.foundation.processes.child import ChildProcess, exit_status_text
from wil_campaign.foundation.processes.last_output import last_output, output_with_interpreter
from wil_campaign.foundation.processes.limited_log import limited_log
from wil_campaign.foundation.processes.supervisor import supervised_command
from wil_campaign.plugins.ros2.wire import WireError

_GRACE_S = 3.0
_SUPERVISOR_GRACE_S = 2.0
_LOOK_S = 0.001


class NodeProcess:
    """A node's process, and the end of what it printed. Its state may be asked in any thread.

    name: the command that started it. explain: adds to what it printed what that does not say.
    """

    def __init__(
        self, child: ChildProcess, log: Path, name: str, explain: Callable[[str], str] = str
    ) -> None:
        self.name = name
        self._explain = explain
        self._child = child
        self._log = log
        self.ended_by_us = False

    @property
    def has_ended(self) -> bool:
        """Return whether the node has ended; also while the loop of the run stands still."""
        return self.exit_code is not None

    @property
    def exit_code(self) -> int | None:
        """Return the exit code, negative by a signal; None while it runs."""
        while self._child.exit_code is None and self._child.pid is not None:
            try:
                flags = os.WEXITED | os.WNOHANG | os.WNOWAIT
                found = os.waitid(os.P_PID, self._child.pid, flags)
            except ChildProcessError:
                time.sleep(_LOOK_S)  # the loop has just reaped it, and notes the code
                continue
            if found is None:
                return None
            return found.si_status if found.si_code == os.CLD_EXITED else -found.si_status
        return self._child.exit_code

    def __str__(self) -> str:
        if self.ended_by_us:
            return f"ended with the run ({exit_status_text(self.exit_code)})"
        return f"{exit_status_text(self.exit_code)} by itself" if self.has_ended else "runs"

    @property
    def ending(self) -> str:
        """Return how the node ended, with what it printed last."""
        return ": ".join(filter(None, (str(self), self.last_lines())))

    def last_lines(self) -> str:
        """Return what the node printed last, in one line; "" for nothing."""
        return self._explain(last_output(self._log))


@asynccontextmanager
async def started_node(
    argv: Sequence[str],
    *,
    environment: Mapping[str, str],
    folder: Path,
    log: Path,
    on_end: Callable[[], None],
    inherited: Sequence[int] = (),
) -> AsyncIterator[NodeProcess]:
    """Run a node; its whole process group is ended on leaving. Raises WireError.

    on_end: called in the loop when it ends by itself. inherited: descriptors that it gets; such a
    one is no user's, and has no supervisor, which would keep them.
    """
    command = tuple(argv)
    if not inherited:
        command = supervised_command(argv, parent=os.getpid(), grace_s=_SUPERVISOR_GRACE_S)
    with limited_log(log) as output:
        child = ChildProcess(
            argv=command,
            environment=environment,
            folder=folder,
            output=output,
            inherited=inherited,
            grace_s=_GRACE_S,
        )
        explain = partial(
            output_with_interpreter, argv=argv, environment=environment, folder=folder
        )
        node = NodeProcess(child, log, " ".join(argv[:3]), explain)

        def ended(_: ChildProcess) -> None:
            if not node.ended_by_us:
                on_end()

        try:
            child.start(ended)
        except OSError as error:
            raise WireError(f"the node cannot be started: {argv[0]}: {error.strerror}") from error
        try:
            yield node
        finally:
            node.ended_by_us = not node.has_ended
            await child.end()
