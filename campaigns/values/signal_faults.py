"""Faults that are injected into the signals of a run: a sensor or pose source stops or freezes."""

from dataclasses import dataclass

from wil_campaign.vehicles.faults import FaultKind

_TEXTS: dict[FaultKind, str] = {"stop": "stops", "freeze": "freezes"}


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalFault:
    """A signal that stops or freezes, after_s after a stage, for for_s (None: until the end).

    sensor: its name; None for the pose source of the vehicle.
    """

    vehicle: str
    sensor: str | None
    kind: FaultKind
    stage: str
    after_s: float = 0.0
    for_s: float | None = None

    def __str__(self) -> str:
        """Return the fault in words."""
        signal = "pose source" if self.sensor is None else f"autonomy's sensor {self.sensor}"
        lasts = "" if self.for_s is None else f" for {self.for_s:g} s"
        when = f"{self.after_s:g} s after stage {self.stage}"
        return f"the {signal} of {self.vehicle} {_TEXTS[self.kind]} {when}{lasts}"
