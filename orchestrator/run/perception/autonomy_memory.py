"""What the autonomy under test holds in memory, beside its limit."""

from collections.abc import Callable

from campaigns.values.autonomy_limits import AutonomyLimits
from vehicles.process_memory import resident_mb

_BACKSTOP = 2.0
"""Times the limit from which on the kernel refuses memory: our own code needs some to land by."""


class MemoryMeter:
    """Measures how far the run's process grows from now on. resident_mb: measures the process.

    What the run itself needs meanwhile (images, recordings) counts too: it is a bound on a machine,
    no measure of an autonomy.
    """

    def __init__(
        self, limits: AutonomyLimits, *, resident_mb: Callable[[], float] = resident_mb
    ) -> None:
        self._limits = limits
        self._resident_mb = resident_mb
        self._before_mb = resident_mb()

    @property
    def backstop_mb(self) -> float:
        """Return from which growth on the kernel shall refuse memory."""
        return _BACKSTOP * self._limits.memory_mb

    def excess(self) -> str:
        """Return in words by how much the limit is exceeded; empty while it is not."""
        grown_mb = self._resident_mb() - self._before_mb
        return self._limits.excess("the run's process has grown by", grown_mb)
