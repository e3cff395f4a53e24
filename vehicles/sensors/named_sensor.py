"""Names the sensor, and its plugin, where a sensor's model fails."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from wil_campaign.installed_plugins import plugin_of_module, whose_fault_text
from wil_campaign.vehicles.readings import Reading
from wil_campaign.vehicles.sensors.sensor_spec import Sensor, SensorSpec
from wil_campaign.vehicles.sensors.truth import Truth


class NamedSensor:
    """A sensor's model whose exceptions name it, and that gives readings of its type alone.

    name: in messages, as "sonar down of twin". make: makes the model.
    """

    def __init__(self, name: str, spec: SensorSpec, make: Callable[[], Sensor]) -> None:
        self._name = name
        self._reading = spec.reading
        self._plugin = plugin_of_module(spec.reading.__module__)
        with self._named():
            self._sensor = make()

    def sample(self, truth: Truth, t_s: float, rng: np.random.Generator) -> Reading:
        """Return the sensor's reading of t_s."""
        with self._named():
            reading: Reading = self._sensor.sample(truth, t_s, rng)
            if type(reading) is not self._reading:
                given = type(reading).__name__
                raise TypeError(f"gave {given}, not {self._reading.__name__}")
        return reading

    @contextmanager
    def _named(self) -> Iterator[None]:
        try:
            yield
        except Exception as error:
            error.add_note(f"({self._name}){whose_fault_text(self._plugin)}")
            raise
