"""The observers of a run are called in order; their results stand beside those of the sources."""

import asyncio
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.orchestrator.external import external_io
from wil_campaign.orchestrator.external.external_io import ExternalIo
from wil_campaign.orchestrator.run_results.result_parts import ExternalResult, InjectedResult
from wil_campaign.orchestrator.state.observer import Observer
from wil_campaign.safety.model.oracle_results import Flag
from wil_campaign.vehicles.readings import CameraReading
from wil_campaign.worlds.camera import Intrinsics

OPTICS = Intrinsics.from_fov(2, 2, 1.0)
IMAGE = CameraReading(1.0, 1.0, 0, "real", np.zeros((2, 2, 3), np.uint8), OPTICS, sensor="camera")


class Noting(Observer):
    def __init__(self, name: str, noted: list[str]) -> None:
        self.name = name
        self.noted = noted

    async def before_arming(self, unbooted: Any, /) -> str:
        return f"{self.name} is ready for {' '.join(unbooted)}" if self.name != "quiet" else ""

    def perceived(self, reading: Any, by: tuple[str, ...]) -> None:
        self.noted.append(f"{self.name} perceived {reading.sensor} {by}")

    def untouched(self, reading: Any) -> None:
        self.noted.append(f"{self.name} untouched {reading.sensor}")

    def contact(self, flag: Flag) -> None:
        self.noted.append(f"{self.name} contact {flag.text}")

    @property
    def result(self) -> ExternalResult:
        return ExternalResult(injected=(InjectedResult(self.name, "x", 1, 0, 0),))


def external(monkeypatch: pytest.MonkeyPatch, noted: list[str], *names: str) -> ExternalIo:
    """Return the external I/O of a run without sources, with observers of these names."""
    monkeypatch.setattr(
        external_io, "_observers", lambda *_: [Noting(name, noted) for name in names]
    )
    campaign = SimpleNamespace(recipe=None, world=SimpleNamespace(frame=None))
    setup = SimpleNamespace(with_sensors=(), vehicles=(), clock="virtual", case=campaign)
    return ExternalIo(setup=cast("Any", setup), events={})


def test_each_observer_is_called_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    noted: list[str] = []
    run = external(monkeypatch, noted, "a", "b")
    run.perceived(IMAGE, ["real"])
    run.untouched(IMAGE)
    run.contact(Flag(1.0, "collision", "real", "touched gate"))
    assert noted == [
        "a perceived camera ('real',)",
        "b perceived camera ('real',)",
        "a untouched camera",
        "b untouched camera",
        "a contact touched gate",
        "b contact touched gate",
    ]
    assert [one.vehicle for one in run.result.injected] == ["a", "b"]


def test_the_checks_of_all_observers_are_one_text(monkeypatch: pytest.MonkeyPatch) -> None:
    async def checked(*names: str) -> str:
        await asyncio.sleep(0.0)
        run = external(monkeypatch, [], *names)
        return await run.before_arming(unbooted={"real": frozenset()})

    assert run_virtual(checked("a", "quiet", "b")) == "a is ready for real; b is ready for real"
    assert run_virtual(checked("quiet")) == "nothing external"
