"""Internal exceptions in a run or a campaign: recorded and logged, so that none is lost."""

import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from wil_campaign.foundation.tasks import FAULTS, is_task_cancellation, leaf_errors
from wil_campaign.installed_plugins import plugin_at_fault, whose_fault_text
from wil_campaign.orchestrator.state.run_log import append_event


@dataclass(frozen=True, slots=True)
class InternalFault:
    """An internal exception. where: the task or part that raised it; kind: its type."""

    t_s: float
    where: str
    kind: str
    message: str
    trace: str

    @classmethod
    def of(cls, error: BaseException, where: str, t_s: float) -> Self:
        """Return the fault record of an exception."""
        try:
            message = " ".join([str(error), *getattr(error, "__notes__", ())])
        except Exception as other:  # noqa: BLE001 - __str__ may raise anything
            message = f"(its message raised {type(other).__name__})"
        plugin = plugin_at_fault(error)
        message += "" if plugin in message else whose_fault_text(plugin)
        trace = "".join(traceback.format_exception(error))
        return cls(t_s, where, type(error).__name__, message, trace)

    @property
    def text(self) -> str:
        """Return the fault in a line."""
        text = f"{self.kind}: {self.message}" if self.message else self.kind
        return f"{self.where}: {text}"


FaultLog = Callable[[InternalFault], None]


class InternalFaults:
    """All faults (internal exceptions) of a run, each once however often it propagates.

    time: in seconds, as in the log. log: writes each new fault; take: called with it after that. An
    exception of `take` is a further fault, with which `take` is not called.
    """

    def __init__(
        self, *, time: Callable[[], float], log: FaultLog, take: Callable[[InternalFault], None]
    ) -> None:
        self._time = time
        self._log = log
        self._take = take
        self._known: list[BaseException] = []
        self.all: list[InternalFault] = []

    def record(self, error: BaseException, where: str) -> None:
        """Record an exception as a fault, or each of a group of them."""
        for leave in leaf_errors(error):
            if not self._is_known(leave):
                self._hand_over(self._record(leave, where))

    def _is_known(self, error: BaseException) -> bool:
        return any(error is known for known in self._known)

    def _record(self, error: BaseException, where: str) -> InternalFault:
        self._known.append(error)
        fault = InternalFault.of(error, where, self._time())
        self.all.append(fault)
        self._log(fault)
        return fault

    def _hand_over(self, fault: InternalFault) -> None:
        """Call `take` with a fault: whoever shows or handles it must not end what goes on."""
        try:
            self._take(fault)
        except FAULTS as error:
            if is_task_cancellation(error):
                raise
            for leave in leaf_errors(error):
                if not self._is_known(leave):
                    self._record(leave, f"the report of a fault in {fault.where}")

    @contextmanager
    def recording(self, where: str) -> Iterator[None]:
        """Record an exception raised within as a fault, and suppress it.

        A requested cancellation is raised.
        """
        try:
            yield
        except FAULTS as error:
            if is_task_cancellation(error):
                raise
            self.record(error, where)


def fault_log(path: Path) -> FaultLog:
    """Return a function that appends faults to a log.jsonl, also while its recorder is closed."""

    def write(fault: InternalFault) -> None:
        with suppress(OSError):  # The verdict states it, too.
            append_event(
                path,
                fault.t_s,
                "error",
                where=fault.where,
                type=fault.kind,
                message=fault.message,
                trace=fault.trace,
            )

    return write
