"""An autopilot's own fence is exchanged: offered, confirmed or put back, given back at the end."""

import asyncio
import errno
import os
import shutil
import threading
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from tests.vehicles.driver.onboard.slow_disks import SlowDisk, end_threads
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.plugins.impaired_links.impaired import ImpairedLink
from wil_campaign.plugins.impaired_links.impairment import Impairment
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.driver.onboard import disk_access, onboard_fence
from wil_campaign.vehicles.driver.onboard.crash_safe_file import CrashSafeFile
from wil_campaign.vehicles.driver.onboard.fence_backup import back_up_fence, restore_fence
from wil_campaign.vehicles.driver.onboard.fence_protocol import AutopilotFence
from wil_campaign.vehicles.driver.onboard.mission_protocol import MissionError
from wil_campaign.vehicles.driver.onboard.onboard_fence import OnboardFence
from wil_campaign.vehicles.embedded.physics.config import EmbeddedConfig
from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle
from wil_campaign.vehicles.errors import ParameterError, VehicleError
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.mavlink.fence_areas import FenceCircle, FencePlace

BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
HOME = FencePlace(47.397742, 8.545594)


def around(radius_m: float, ceiling_m: float | None) -> AutopilotFence:
    return AutopilotFence(areas=(FenceCircle(HOME, radius_m),), ceiling_m=ceiling_m)


ITS_OWN, FIRST, SECOND = around(90.0, None), around(20.0, 12.0), around(10.0, 6.0)
Script = Callable[["Rig"], Awaitable[Any]]


class Rig:
    """A vehicle that has a fence of its own, and a link that can go dark."""

    def __init__(self, driver: Driver, vehicle: EmbeddedVehicle, link: ImpairedLink) -> None:
        self.driver = driver
        self.vehicle = vehicle
        self.link = link

    def kept(self, journal: Path | None = None) -> OnboardFence:
        return OnboardFence(
            fences=self.driver.onboard.fences,
            parameters=self.driver.parameters,
            autopilot=self.driver.identity.autopilot,
            backup_folder=journal,
        )

    @property
    def radius_m(self) -> float:
        (area,) = self.vehicle.autopilot.fence.areas
        return area.radius_m  # type: ignore[union-attr]  # no polygon

    @property
    def has(self) -> tuple[float, float]:
        """Return the radius and the ceiling that it keeps."""
        px4 = self.driver.identity.autopilot == "px4"
        ceiling = "GF_MAX_VER_DIST" if px4 else "FENCE_ALT_MAX"
        return self.radius_m, self.vehicle.autopilot.parameters[ceiling]

    @property
    def parameters(self) -> dict[str, float]:
        names = ("GF_MAX_VER_DIST", "GF_ACTION", "FENCE_TYPE", "FENCE_ALT_MAX", "FENCE_MARGIN")
        known = self.vehicle.autopilot.parameters
        return {name: known[name] for name in names if name in known}


def files(folder: Path) -> int:
    return len(list(folder.iterdir()))


def with_vehicle(autopilot: str, script: Script) -> None:
    async def run() -> None:
        ours, theirs = memory_pair(latency_s=0.003)
        link = ImpairedLink(
            link=ours, outgoing=Impairment(), incoming=Impairment(), rng=np.random.default_rng(1)
        )
        config = EmbeddedConfig(autopilot=autopilot)
        async with (
            EmbeddedVehicle(config=config, link=theirs, seed=1) as vehicle,
            Driver(name="real", link=link) as driver,
        ):
            await driver.identify(8.0)
            await driver.onboard.fences.upload(ITS_OWN.areas)
            await script(Rig(driver, vehicle, link))

    run_virtual(run())


@BOTH
def test_a_fence_that_is_put_back_is_as_before_the_offer(autopilot: str) -> None:
    async def script(rig: Rig) -> None:
        before = rig.parameters
        async with rig.kept() as kept:
            await kept.put_back()
            await kept.offer(FIRST)
            assert rig.has == (20.0, 12.0)
            await kept.put_back()
            assert rig.radius_m == 90.0
            assert rig.parameters == before
            await kept.keep(FIRST)
            await kept.offer(SECOND)
            assert rig.has == (10.0, 6.0)
            assert kept.unsettled
            await kept.put_back()
            assert rig.has == (20.0, 12.0)
            assert not kept.unsettled
        assert rig.radius_m == 90.0
        assert rig.parameters == before

    with_vehicle(autopilot, script)


@BOTH
@pytest.mark.parametrize("settled", [True, False])
def test_the_vehicles_own_fence_is_given_back_after_changes(
    autopilot: str, settled: bool, tmp_path: Path
) -> None:
    async def script(rig: Rig) -> None:
        before = rig.parameters
        async with rig.kept(tmp_path) as kept:
            await kept.keep(FIRST)
            await kept.offer(SECOND)
            if settled:
                await kept.confirm()
        assert rig.radius_m == 90.0
        assert rig.parameters == before
        assert files(tmp_path) == 0

    with_vehicle(autopilot, script)


@BOTH
def test_after_a_kill_all_changes_are_set_back(autopilot: str, tmp_path: Path) -> None:
    async def script(rig: Rig) -> None:
        before = rig.parameters
        kept = rig.kept(tmp_path / "journals")
        await kept.keep(FIRST)
        await kept.offer(SECOND)
        await kept.confirm()
        # A copy is held by nobody, as the journals of a program that was killed.
        left = tmp_path / "left"
        shutil.copytree(tmp_path / "journals", left)
        assert files(left) == 4
        await rig.driver.parameters.restore_backups(left)
        assert rig.parameters == before
        fences, vehicle = rig.driver.onboard.fences, rig.driver.parameters.vehicle
        assert not await restore_fence(left, fences=fences, vehicle="another")
        assert rig.radius_m == 10.0
        assert await restore_fence(left, fences=fences, vehicle=vehicle)
        assert rig.radius_m == 90.0
        assert files(left) == 0

    with_vehicle(autopilot, script)


@BOTH
def test_a_fence_that_somebody_drew_since_is_left_alone(autopilot: str, tmp_path: Path) -> None:
    async def script(rig: Rig) -> None:
        fences = rig.driver.onboard.fences
        await rig.kept(tmp_path / "journals").keep(FIRST)
        shutil.copytree(tmp_path / "journals", tmp_path / "left")
        await fences.upload(around(33.0, None).areas)
        vehicle = rig.driver.parameters.vehicle
        assert not await restore_fence(tmp_path / "left", fences=fences, vehicle=vehicle)
        assert rig.radius_m == 33.0

    with_vehicle(autopilot, script)


def test_a_fence_backup_that_cannot_be_restored_is_named(tmp_path: Path) -> None:
    class Refusing:
        async def items(self) -> Any:
            raise MissionError("it was refused with MAV_MISSION_DENIED")

    back_up_fence(tmp_path / "journals", "x", own=(), ours=()).close()
    with pytest.raises(MissionError) as refused:
        run_virtual(
            restore_fence(tmp_path / "journals", fences=cast("Any", Refusing()), vehicle="x")
        )
    (backup,) = (tmp_path / "journals").iterdir()
    assert str(refused.value) == (
        "could not restore the fence that an earlier run replaced (it was refused with "
        f"MAV_MISSION_DENIED); try again, or set it yourself and remove {backup}"
    )


def test_a_spoilt_note_is_reported(tmp_path: Path) -> None:
    (tmp_path / "000001.fence.json").write_text("{}")

    async def script(rig: Rig) -> None:
        with pytest.raises(MissionError, match=r"000001.fence.json is not a fence backup"):
            await restore_fence(tmp_path, fences=rig.driver.onboard.fences, vehicle="x")

    with_vehicle("px4", script)


@BOTH
def test_a_link_that_is_lost_in_the_middle(autopilot: str) -> None:
    async def script(rig: Rig) -> None:
        kept = rig.kept()
        await kept.keep(FIRST)
        loop = asyncio.get_running_loop()
        loop.call_later(0.01, rig.link.start_outage, 12.0)
        with pytest.raises(MissionError, match="no answer"):
            await kept.offer(SECOND)
        with pytest.raises(VehicleError):
            await kept.put_back()
        assert kept.unsettled
        await asyncio.sleep(12.0)
        await kept.put_back()
        assert rig.has == (20.0, 12.0)

    with_vehicle(autopilot, script)


@BOTH
def test_an_offer_that_is_cancelled_can_be_put_back(autopilot: str) -> None:
    async def script(rig: Rig) -> None:
        kept = rig.kept()
        await kept.keep(FIRST)
        for after_s in np.arange(0.002, 0.2, 0.012):
            offer = asyncio.create_task(kept.offer(SECOND))
            await asyncio.sleep(float(after_s))
            offer.cancel()
            await asyncio.wait([offer])
            await kept.put_back()
            assert rig.has == (20.0, 12.0), after_s

    with_vehicle(autopilot, script)


@BOTH
@pytest.mark.parametrize("cancelled", [False, True])
def test_the_loop_runs_on_while_the_disk_takes_the_fences_backup(
    autopilot: str, cancelled: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def script(rig: Rig) -> None:
        async with rig.kept(tmp_path) as kept:
            disk = SlowDisk(monkeypatch)
            offer = asyncio.create_task(kept.offer(FIRST))
            waiting = asyncio.create_task(disk.reached())
            await asyncio.wait({offer, waiting}, return_when=asyncio.FIRST_COMPLETED)
            assert rig.radius_m == 90.0
            if cancelled:
                offer.cancel()
                await asyncio.sleep(0)
            disk.release()
            await asyncio.wait([offer])
            assert offer.cancelled() is cancelled
            assert rig.radius_m == (90.0 if cancelled else 20.0)
            assert files(tmp_path) == (1 if cancelled else 2)
            await kept.put_back()
            assert rig.radius_m == 90.0
        assert files(tmp_path) == 0

    with_vehicle(autopilot, script)


def test_a_disk_that_is_dead_ends_the_offer_and_the_vehicle_keeps_its_fence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(disk_access, "_MOST_POLLS", 2)

    async def script(rig: Rig) -> None:
        async with rig.kept(tmp_path) as kept:
            disk = SlowDisk(monkeypatch)
            with pytest.raises(MissionError, match=r"written \(the disk takes nothing\)"):
                await kept.offer(FIRST)
            await kept.put_back()
            assert rig.radius_m == 90.0
            disk.release()
            await asyncio.to_thread(end_threads, "fence backup")
            assert files(tmp_path) == 0

    with_vehicle("ardupilot", script)


def test_a_disk_that_dies_before_the_fences_backup_is_removed_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    removed, released = CrashSafeFile.remove, threading.Event()

    def remove(file: CrashSafeFile) -> None:
        if file.path.name.endswith(".fence.json"):
            assert released.wait(20.0)
        removed(file)

    async def remove_soon(path: Path, remove: Callable[[], None], *, name: str) -> str:
        """Lower the limit only now: whatever else is written and removed is on a real disk."""
        monkeypatch.setattr(disk_access, "_MOST_POLLS", 2)
        return await disk_access.remove_backup(path, remove, name=name)

    async def script(rig: Rig) -> None:
        kept = rig.kept(tmp_path)
        await kept.keep(FIRST)
        said = r"is restored, but its backup .*000001.* cannot be removed .the disk takes nothing"
        with pytest.raises(MissionError, match=said):
            await kept.__aexit__(None, None, None)
        assert rig.radius_m == 90.0

    monkeypatch.setattr(onboard_fence, "remove_backup", remove_soon)
    monkeypatch.setattr(CrashSafeFile, "remove", remove)
    try:
        with_vehicle("ardupilot", script)
        assert files(tmp_path) == 1
    finally:
        released.set()
        end_threads("fence backup")
    assert files(tmp_path) == 0


@BOTH
def test_a_backup_that_cannot_be_removed_does_not_keep_the_fence_from_being_put_back(
    autopilot: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A memory card that fails is mounted read-only, in flight."""

    removed, is_read_only = CrashSafeFile.remove, threading.Event()

    def remove(file: CrashSafeFile) -> None:
        if is_read_only.is_set():
            raise OSError(errno.EROFS, os.strerror(errno.EROFS))
        removed(file)

    async def script(rig: Rig) -> None:
        kept = rig.kept(tmp_path)
        await kept.keep(FIRST)
        await kept.offer(SECOND)
        is_read_only.set()
        said = r"are restored, but their backup .* cannot be removed \(Read-only"
        with pytest.raises(ParameterError, match=said):
            await kept.put_back()
        assert rig.has == (20.0, 12.0)
        assert not kept.unsettled
        with pytest.raises(VehicleError, match="their backup") as caught:
            await kept.__aexit__(None, None, None)
        assert any("its backup" in note for note in caught.value.__notes__), "none hides the other"
        assert rig.radius_m == 90.0

    monkeypatch.setattr(CrashSafeFile, "remove", remove)
    with_vehicle(autopilot, script)


def test_a_parameter_that_is_refused_leaves_all_as_it_was() -> None:
    async def script(rig: Rig) -> None:
        kept = rig.kept()
        await kept.keep(around(20.0, None))
        rig.vehicle.autopilot.parameters._entries.pop("FENCE_ALT_MAX")
        with pytest.raises(ParameterError, match="FENCE_ALT_MAX"):
            await kept.offer(SECOND)
        await kept.put_back()
        assert rig.radius_m == 20.0

    with_vehicle("ardupilot", script)


def test_an_arducopter_keeps_no_further_from_the_fence_than_the_guard() -> None:
    async def script(rig: Rig) -> None:
        assert rig.parameters["FENCE_MARGIN"] == 2.0
        async with rig.kept() as kept:
            await kept.keep(FIRST)
            assert rig.parameters["FENCE_MARGIN"] == 0.0
        assert rig.parameters["FENCE_MARGIN"] == 2.0

    with_vehicle("ardupilot", script)
