"""The check of readings before they are mixed: type, values, and order in time."""

from collections import Counter, deque

from wil_campaign.vehicles.readings import Reading, sensor_type_of
from wil_campaign.vehicles.readings.checks import reading_fault, reading_fault_after
from wil_campaign.vehicles.readings.faults import ReadingFault

_REMEMBERED = 64


class ReadingIntake:
    """The intake check of one side's readings, each by itself and against the one before.

    A reading that is older than the newest accepted one is always refused. One that differs in size
    or intrinsics is refused once, so that the change is counted, and accepted from then on. An
    accepted reading may come again, also after newer ones: a slow source is held, and a mixture
    may use an older reading. tolerated: kinds of fault that the first steps correct.
    """

    def __init__(self, side: str, kind: str, tolerated: frozenset[str] = frozenset()) -> None:
        self.kind = kind
        self.faults: Counter[str] = Counter()
        self._side = side
        self._tolerated = tolerated
        self._previous: Reading | None = None
        self._accepted: deque[tuple[int, float]] = deque(maxlen=_REMEMBERED)

    def fault_of(self, reading: Reading) -> str | None:
        """Return the fault of an arriving reading in words; None for a good one."""
        # A key instead of the reading itself, which would keep the memory of its image.
        key = (id(reading), reading.t_s)
        if key in self._accepted:
            return None
        fault = self._type_fault(reading) or self._own_fault(reading) or self._order_fault(reading)
        if fault is None:
            self._previous = reading
            self._accepted.append(key)
            return None
        self.faults[f"{self._side} {fault.kind}"] += 1
        return f"{self.kind} reading of {self._side}: {fault.detail}"

    def _type_fault(self, reading: Reading) -> ReadingFault | None:
        kind = sensor_type_of(reading)
        return None if kind == self.kind else ReadingFault("type", f"is of type {kind}")

    def _own_fault(self, reading: Reading) -> ReadingFault | None:
        fault = reading_fault(reading)
        return None if fault is not None and fault.kind in self._tolerated else fault

    def _order_fault(self, reading: Reading) -> ReadingFault | None:
        previous = self._previous
        fault = reading_fault_after(reading, previous)
        if fault is None or previous is None or reading.t_s == previous.t_s:
            return None
        if fault.kind != "backwards":
            self._previous = reading
        return fault
