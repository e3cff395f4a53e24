"""What is let into a mixture: readings of the right type, whole, and not from the past."""

from collections import Counter, deque

from vehicles.readings import Reading, sensor_type_of
from vehicles.readings.checks import Fault, fault_after, fault_of

_REMEMBERED = 64


class Intake:
    """The intake check of one side's readings, each by itself and against the one before.

    A reading that is older than the one before is refused, as long as it takes; one that differs
    in size or intrinsics is refused once, so that the change is counted, and then let in. One
    that was let in may come again, also behind newer ones: a slow source is held, and a mixture
    may choose an older reading. tolerated: kinds of fault that the first steps are there to mend.
    """

    def __init__(self, side: str, kind: str, tolerated: frozenset[str] = frozenset()) -> None:
        self.kind = kind
        self.faults: Counter[str] = Counter()
        self._side = side
        self._tolerated = tolerated
        self._previous: Reading | None = None
        self._let_in: deque[tuple[int, float]] = deque(maxlen=_REMEMBERED)

    def fault_of(self, reading: Reading) -> str | None:
        """Return what is wrong with an arriving reading; None when nothing is."""
        # Not the reading itself: a picture that is remembered is memory that is held.
        key = (id(reading), reading.t_s)
        if key in self._let_in:
            return None
        fault = self._of_kind(reading) or self._in_itself(reading) or self._after(reading)
        if fault is None:
            self._previous = reading
            self._let_in.append(key)
            return None
        self.faults[f"{self._side} {fault.kind}"] += 1
        return f"{self.kind} reading of {self._side}: {fault.detail}"

    def _of_kind(self, reading: Reading) -> Fault | None:
        kind = sensor_type_of(reading)
        return None if kind == self.kind else Fault("type", f"is of type {kind}")

    def _in_itself(self, reading: Reading) -> Fault | None:
        fault = fault_of(reading)
        return None if fault is not None and fault.kind in self._tolerated else fault

    def _after(self, reading: Reading) -> Fault | None:
        previous = self._previous
        fault = fault_after(reading, previous)
        if fault is None or previous is None or reading.t_s == previous.t_s:
            return None
        if fault.kind != "backwards":
            self._previous = reading
        return fault
