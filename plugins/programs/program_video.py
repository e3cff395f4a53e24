"""The video of an autonomy program: the images of one camera, and whether enough are sent."""

from wil_campaign.orchestrator.run_results.result_parts import OutletResult
from wil_campaign.plugins.outlets.image_delivery import DeliveryCounts, ImageDelivery
from wil_campaign.vehicles.readings import CameraReading, Reading

_WINDOW_S = 2.0
"""How long a program may be blind, as an object may be in view without being shown."""
_LEAST_SHARE = 0.5
"""Least share of the images that has to be sent: a few may be dropped while the encoder is busy."""


class ProgramVideo:
    """Sends the images of one camera to a program, and checks while the goal is flown that it can.

    sensor: the camera that the program perceives; readings of others are not sent. period_s: of its
    images.
    """

    def __init__(self, *, sensor: str, period_s: float, delivery: ImageDelivery) -> None:
        self.sensor = sensor
        self._window_s = max(_WINDOW_S, 2.0 * period_s)
        self.delivery = delivery
        self._goal = self._checked = DeliveryCounts()
        self._checked_s = 0.0

    def perceive(self, reading: Reading) -> None:
        """Send a reading if it is an image of the program's camera."""
        if isinstance(reading, CameraReading) and reading.sensor == self.sensor:
            self.delivery.deliver(reading)

    def begin(self, now_s: float) -> None:
        """Begin to check: the goal is given."""
        self._goal = self._checked = self.delivery.counts
        self._checked_s = now_s

    def fault(self, now_s: float) -> str:
        """Return why too few of the last seconds' images were sent; "" while enough are."""
        if now_s - self._checked_s < self._window_s:
            return ""
        before, self._checked = self._checked, self.delivery.counts
        self._checked_s = now_s
        if self._checked.offered == before.offered:
            return f"no image of '{self.sensor}' came for its program for {self._window_s:g} s"
        return self._fault_of(before, self._checked)

    def fault_in_all(self) -> str:
        """Return why too few images were sent since the goal was given; "" if enough were."""
        return self._fault_of(self._goal, self.delivery.counts)

    @property
    def result(self) -> OutletResult:
        """Return the images that were sent and those that were not."""
        counts = self.delivery.counts
        return OutletResult(
            name=self.delivery.name,
            offered=counts.offered,
            delivered=counts.delivered,
            dropped=counts.dropped,
            failed=counts.failed,
            trouble=self.delivery.trouble,
        )

    def _fault_of(self, before: DeliveryCounts, after: DeliveryCounts) -> str:
        sent = after.delivered - before.delivered
        failed = after.failed - before.failed
        # Images that still wait to be sent do not count.
        count = sent + failed + after.dropped - before.dropped
        if sent >= _LEAST_SHARE * count:
            return ""
        why = self.delivery.trouble if failed else ""
        why = why or (
            "newer ones came before they were encoded; run less beside the flight, or give the "
            "camera a lower rate or smaller images"
        )
        return f"only {sent} of {count} images of '{self.sensor}' were sent to its program: {why}"
