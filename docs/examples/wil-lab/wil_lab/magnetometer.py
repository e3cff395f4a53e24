from dataclasses import dataclass

from wil_campaign.api import NumbersReading, SensorOptions, SensorSpec, rotate


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldReading(NumbersReading):
    """x_ut, y_ut, z_ut: microtesla in the body's FRD axes."""

    x_ut: float
    y_ut: float
    z_ut: float


class FieldOptions(SensorOptions):
    """A magnetometer. rate_hz: samples in a second. north_ut: strength of the field."""

    rate_hz: float = 20.0
    north_ut: float = 20.0


class Magnetometer:
    def __init__(self, options, site):
        self.side, self.north_ut = site.side, options.north_ut

    def sample(self, truth, t_s, rng):
        w, x, y, z = truth.pose.q_wxyz
        field = rotate((w, -x, -y, -z), (self.north_ut, 0.0, 0.0))
        numbers = dict(zip(("x_ut", "y_ut", "z_ut"), field, strict=True))
        return FieldReading(t_s=t_s, arrived_s=t_s, seq=0, source=self.side, **numbers)


def fault(reading):
    return "" if abs(reading.x_ut) < 100 else f"{reading.x_ut:.0f} uT is none of the earth"


MAGNETOMETER = SensorSpec("magnetometer", FieldReading, FieldOptions, Magnetometer, fault)
