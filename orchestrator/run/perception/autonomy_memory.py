"""Memory use of the autonomy under test against its limit."""

from collections.abc import Callable

from wil_campaign.campaigns.values.autonomy_limits import AutonomyLimits
from wil_campaign.foundation.processes.process_memory import resident_mb

_BACKSTOP = 2.0
"""Times the limit at which the kernel refuses memory: landing the vehicles needs some, too."""


class MemoryMeter:
    """Measures how far the run's process grows from now on. resident_mb: measures the process.

    Memory of the run itself (images, recordings) counts too: the limit protects the machine and
    does not measure an autonomy.
    """

    def __init__(
        self, limits: AutonomyLimits, *, resident_mb: Callable[[], float] = resident_mb
    ) -> None:
        self._limits = limits
        self._resident_mb = resident_mb
        self._before_mb = resident_mb()

    @property
    def backstop_mb(self) -> float:
        """Return the growth beyond which the kernel is to refuse memory."""
        return _BACKSTOP * self._limits.memory_mb

    def excess(self) -> str:
        """Return in words by how much the limit is exceeded; empty while it is not."""
        grown_mb = self._resident_mb() - self._before_mb
        return self._limits.excess("the run's process has grown by", grown_mb)
