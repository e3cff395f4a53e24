"""What tests of sensor models share: a truth, a generator, and that equal seeds give the same."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from wil_campaign.vehicles.readings import Reading
from wil_campaign.vehicles.readings.checks import reading_fault
from wil_campaign.vehicles.sensors.noise_sets import NoiseSetName
from wil_campaign.vehicles.sensors.truth import Truth
from wil_campaign.worlds.frames import Pose

HOVER = Truth(Pose.of(1.0, 2.0, 3.0, yaw_rad=0.5), motor_speeds_rad_s=(469.0,) * 4)
Sample = Callable[[float, np.random.Generator], Reading]


def rng(seed: int = 1) -> np.random.Generator:
    return np.random.default_rng(seed)


def sampling(sensors: Sequence[Any]) -> list[Sample]:
    """Return what samples each sensor of a vehicle that hovers."""
    return [partial(_sampled, sensor) for sensor in sensors]


def _sampled(sensor: Any, t_s: float, generator: np.random.Generator) -> Reading:
    reading: Reading = sensor.sample(HOVER, t_s, generator)
    return reading


def require_repeatable(
    sensors: Callable[[NoiseSetName], Sequence[Any]], kind: NoiseSetName
) -> None:
    """Equal seeds give equal readings, others do not where there is noise; none has a fault."""

    def run(seed: int) -> list[str]:
        generator = rng(seed)
        samples = sampling(sensors(kind))
        return [_flat(sample(0.1 * k, generator)) for sample in samples for k in range(1, 4)]

    assert run(3) == run(3)
    noisy = kind == "datasheet"
    equal = [a == b for a, b in zip(run(3), run(4), strict=True)]
    assert equal == [not noisy] * len(equal)
    for sample in sampling(sensors(kind)):
        assert reading_fault(sample(1.0, rng())) is None


def _flat(reading: Reading) -> str:
    return "".join(
        value.tobytes().hex() if isinstance(value, np.ndarray) else repr(value)
        for name in reading.__slots__
        for value in [getattr(reading, name)]
    )
