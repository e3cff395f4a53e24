"""For tests of ArduPilot: the rig with one embedded vehicle, which is explained there."""

from tests.vehicles.embedded.conftest import rig, virtually  # noqa: F401 - fixtures
