"""Parameters of a campaign in a vehicle that runs: set, proven, set back, after a kill as well."""

import asyncio
import errno
import signal
import subprocess
import sys
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from types import MappingProxyType, SimpleNamespace
from typing import Any, cast

import pytest

from wil_campaign.campaigns.schema import PreflightPart
from wil_campaign.campaigns.setup.case_setup import VehicleSetup
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.orchestrator.run.vehicles.arming_record import ArmingRecord
from wil_campaign.orchestrator.run.vehicles.onboard_configuration import OnboardConfiguration
from wil_campaign.orchestrator.run.vehicles.restoration import Restoration
from wil_campaign.orchestrator.state.parameter_backups import parameter_backup_folder
from wil_campaign.orchestrator.state.run_state import FlightError
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.plugins.injection.injection_setups import InjectionSetup
from wil_campaign.plugins.injection.injections import (
    UnsupportedInjectionError,
    prove_injection,
)
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.driver.onboard.fence_backup import back_up_fence
from wil_campaign.vehicles.driver.onboard.vehicle_logs import LogEntry
from wil_campaign.vehicles.embedded.physics.config import EmbeddedConfig
from wil_campaign.vehicles.embedded.profile import load_profile
from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle
from wil_campaign.vehicles.links.link_strings import parse_link
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.mavlink.fence_areas import FenceCircle, FencePlace
from wil_campaign.worlds.frames import AT_ORIGIN

OBSTACLES = InjectionSetup(thing="obstacle_distance", to=("real",), sensor="lidar")
Script = Callable[["Rig"], Awaitable[Any]]


@pytest.fixture(autouse=True)
def _own_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


class Rig:
    """A vehicle that was there before us, and what a run puts onboard."""

    def __init__(self, vehicle: EmbeddedVehicle, driver: Driver, params: dict[str, float]) -> None:
        self.vehicle = vehicle
        self.context = VehicleContext("real", driver, AT_ORIGIN, "mavlink")
        self.setup = VehicleSetup(
            name="real",
            link=parse_link("udpin://127.0.0.1:14540"),
            autopilot=driver.identity.autopilot,
            profile="nominal",
            start=AT_ORIGIN,
            system_id=1,
            params=params,
        )
        self.noted: list[tuple[str, Mapping[str, Any]]] = []
        self.decided: list[tuple[str, ...]] = []
        self.uids: dict[str, str] = {}

    def onboard(
        self,
        preflight: PreflightPart = PreflightPart(fence=None),  # noqa: B008 - frozen
        fences: Mapping[str, Fence] = MappingProxyType({}),
    ) -> OnboardConfiguration:
        campaign = SimpleNamespace(preflight=preflight, fences=fences)
        order = SimpleNamespace(uids=self.uids)
        setup = SimpleNamespace(flown=lambda _: self.setup, case=campaign, order=order)
        run_state = SimpleNamespace(decide=lambda *said: self.decided.append(said), dropped_out={})

        def note(event: str, **more: Any) -> None:
            self.noted.append((event, more))

        self.record = ArmingRecord(now=asyncio.get_running_loop().time, note=note)
        return OnboardConfiguration(
            setup=cast("Any", setup),
            contexts=(self.context,),
            run_state=cast("Any", run_state),
            record=self.record,
            note=note,
        )

    async def prove(self, onboard: OnboardConfiguration) -> None:
        vehicles = {"real": self.setup}
        await prove_injection([self.context], vehicles, [OBSTACLES], unbooted=onboard.unbooted)

    def notes_of(self, event: str) -> list[Mapping[str, Any]]:
        return [more for noted, more in self.noted if noted == event]

    def has(self, name: str) -> float:
        return self.vehicle.autopilot.parameters[name]

    def fence_areas(self) -> int:
        return len(self.vehicle.autopilot.fence.areas)


def with_vehicle(
    autopilot: str,
    script: Script,
    *,
    params: dict[str, float],
    born_with: Mapping[str, float] | None = None,
) -> None:
    async def run() -> None:
        far, near = memory_pair(latency_s=0.003)
        config = EmbeddedConfig(
            autopilot=autopilot,
            profile=load_profile("nominal"),
            source="real",
            parameters=born_with or {},
        )
        async with (
            EmbeddedVehicle(config=config, link=far, seed=1) as vehicle,
            Driver(name="real", link=near, autopilot=autopilot) as driver,
        ):
            await driver.identify(10.0)
            await script(Rig(vehicle, driver, params))

    run_virtual(run())


def test_a_vehicle_in_the_place_of_the_one_that_was_cleared_is_not_touched() -> None:
    """Somebody changed the vehicle between two runs: nobody has consented to arm this one."""

    async def script(rig: Rig) -> None:
        place = "real at udpin://127.0.0.1:14540"
        rig.uids[place] = "4d"
        with pytest.raises(FlightError, match=f"another vehicle is there as {place}: its uid is"):
            await rig.onboard().apply(rig.context)
        assert rig.has("COM_OF_LOSS_T") == 1.0
        rig.uids[place] = rig.context.driver.identity.uid
        onboard = rig.onboard()
        await onboard.apply(rig.context)
        assert rig.has("COM_OF_LOSS_T") == 2.5
        await onboard.restore(at_rest={"real"})

    with_vehicle("px4", script, params={"COM_OF_LOSS_T": 2.5})


@pytest.mark.parametrize(
    ("autopilot", "name", "before"),
    [("ardupilot", "GUID_TIMEOUT", 3.0), ("px4", "COM_OF_LOSS_T", 1.0)],
)
def test_parameters_that_the_campaign_sets_are_set_back(
    autopilot: str, name: str, before: float
) -> None:
    async def script(rig: Rig) -> None:
        onboard = rig.onboard()
        await onboard.apply(rig.context)
        assert rig.has(name) == 5.0
        assert len(list(parameter_backup_folder().iterdir())) == 1
        assert onboard.unbooted == {"real": frozenset({name})}
        parameters, fence = rig.record.steps
        assert (parameters.step, parameters.vehicle, parameters.ok) == ("parameters", "real", True)
        assert (parameters.text, parameters.restored) == (f"{name} 5 (was {before:g})", None)
        assert (fence.step, fence.text) == ("fence", "none uploaded: preflight.fence is null")
        await onboard.restore(at_rest={"real"})
        assert [step.restored for step in rig.record.steps] == [True, True]
        assert rig.has(name) == before
        assert list(parameter_backup_folder().iterdir()) == []
        assert rig.decided == []

    with_vehicle(autopilot, script, params={name: 5.0})


def test_a_parameter_that_counts_at_boot_alone_is_refused_and_set_back() -> None:
    async def script(rig: Rig) -> None:
        onboard = rig.onboard()
        await onboard.apply(rig.context)
        assert rig.has("PRX1_TYPE") == 2.0
        with pytest.raises(
            UnsupportedInjectionError, match=r"PRX1_TYPE was set to 2 since .* reboot it"
        ):
            await rig.prove(onboard)
        await onboard.restore(at_rest={"real"})
        assert (rig.has("PRX1_TYPE"), rig.has("AVOID_ENABLE")) == (0.0, 3.0)

    with_vehicle("ardupilot", script, params={"PRX1_TYPE": 2, "AVOID_ENABLE": 2})


def test_a_vehicle_that_booted_with_it_gets_the_rest_from_the_campaign() -> None:
    async def script(rig: Rig) -> None:
        bare = rig.onboard()
        with pytest.raises(UnsupportedInjectionError, match="set AVOID_ENABLE to 2"):
            await rig.prove(bare)
        onboard = rig.onboard()
        await onboard.apply(rig.context)
        await rig.prove(onboard)
        await onboard.restore(at_rest={"real"})
        assert rig.has("AVOID_ENABLE") == 0.0

    with_vehicle(
        "ardupilot",
        script,
        params={"PRX1_TYPE": 2, "AVOID_ENABLE": 2},
        born_with={"PRX1_TYPE": 2, "AVOID_ENABLE": 0},
    )


_KILLED = """
import asyncio, os, signal, sys
from pathlib import Path
from tests.vehicles.driver.onboard.test_parameter_backup import Access
from wil_campaign.vehicles.driver.onboard.vehicle_logs import LogEntry
from wil_campaign.vehicles.driver.onboard.parameter_backup import ParameterBackup
async def main():
    access = Access(AVOID_MARGIN=2.0)
    async with ParameterBackup(
        access=access, vehicle=sys.argv[2], changes={"AVOID_MARGIN": 9.0}, folder=Path(sys.argv[1])
    ):
        os.kill(os.getpid(), signal.SIGKILL)
asyncio.run(main())
"""


def test_parameters_that_a_killed_run_left_are_set_back_by_the_next_run() -> None:
    async def script(rig: Rig) -> None:
        identity = rig.context.driver.identity
        vehicle = f"ardupilot {identity.system_id} {identity.uid}"
        argv = [sys.executable, "-c", _KILLED, str(parameter_backup_folder()), vehicle]
        killed = await asyncio.to_thread(subprocess.run, argv, check=False, timeout=60)
        assert killed.returncode == -signal.SIGKILL
        assert rig.has("AVOID_MARGIN") == 9.0  # as that run left it
        onboard = rig.onboard()
        await onboard.apply(rig.context)
        assert rig.has("AVOID_MARGIN") == 2.0
        assert rig.noted[0][0] == "parameter"
        assert rig.noted[0][1]["name"] == "AVOID_MARGIN"
        assert rig.notes_of("fence_given_back") == []
        assert rig.has("GUID_TIMEOUT") == 4.0
        await onboard.restore(at_rest={"real"})
        assert (rig.has("AVOID_MARGIN"), rig.has("GUID_TIMEOUT")) == (2.0, 3.0)
        assert list(parameter_backup_folder().iterdir()) == []

    with_vehicle("ardupilot", script, params={"GUID_TIMEOUT": 4.0}, born_with={"AVOID_MARGIN": 9.0})


@pytest.mark.parametrize("settled", [True, False])
@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_an_attached_vehicle_has_its_own_fence_again(autopilot: str, settled: bool) -> None:
    bounds: dict[str, Any] = {"east_m": (-4, 4), "up_m": (-1, 9)}
    first = Fence.box(north_m=(-5, 5), **bounds)
    second = Fence.box(north_m=(-2, 3), east_m=(-1, 1), up_m=(-1, 4))

    async def script(rig: Rig) -> None:
        driver = rig.context.driver
        await driver.ready(90.0)
        where = driver.place_of((0.0, 0.0, 0.0))
        circle = FenceCircle(FencePlace(where.latitude_deg, where.longitude_deg), 40.0)
        fences = driver.onboard.fences
        await fences.upload((FenceCircle(circle.centre, 20.0),))
        of_killed_run = await fences.items()
        await fences.upload((circle,))
        own = await fences.items()
        await fences.restore(of_killed_run)
        folder = parameter_backup_folder()
        back_up_fence(folder, driver.parameters.vehicle, own=own, ours=of_killed_run).close()
        ceiling = "GF_MAX_VER_DIST" if autopilot == "px4" else "FENCE_ALT_MAX"
        before = rig.has(ceiling)
        onboard = rig.onboard(PreflightPart(failsafe="set"), {"real": first})
        await onboard.apply(rig.context)
        assert rig.has(ceiling) == 10.0
        assert rig.notes_of("fence_given_back") == [{"vehicle": "real"}]
        assert rig.notes_of("fence") == [{"vehicle": "real", "areas": 1, "ceiling_m": 10.0}]
        await onboard.fences.offer({"real": second})
        if settled:
            await onboard.fences.confirm()
        assert rig.has(ceiling) == 5.0
        await onboard.restore(at_rest={"real"})
        (area,) = rig.vehicle.autopilot.fence.areas
        assert getattr(area, "radius_m", None) == 40.0
        assert rig.has(ceiling) == before
        assert backups() == 0
        assert rig.decided == []

    with_vehicle(autopilot, script, params={})


@pytest.mark.parametrize("settled", [True, False])
@pytest.mark.parametrize(
    ("autopilot", "name", "ceiling"),
    [
        ("ardupilot", "GUID_TIMEOUT", "FENCE_ALT_MAX"),
        ("px4", "COM_OF_LOSS_T", "GF_MAX_VER_DIST"),
    ],
)
def test_a_vehicle_that_may_still_be_in_the_air_is_restored_by_the_next_start(
    autopilot: str, name: str, ceiling: str, settled: bool
) -> None:
    bounds: dict[str, Any] = {"east_m": (-4, 4), "up_m": (-1, 9)}

    async def script(rig: Rig) -> None:
        await rig.context.driver.ready(90.0)
        before = {each: rig.has(each) for each in (name, ceiling)}
        fenced = {"real": Fence.box(north_m=(-5, 5), **bounds)}
        onboard = rig.onboard(PreflightPart(failsafe="set"), fenced)
        await onboard.apply(rig.context)
        tighter = Fence.box(north_m=(-2, 3), east_m=(-1, 1), up_m=(-1, 4))
        await onboard.fences.offer({"real": tighter})
        if settled:
            await onboard.fences.confirm()
        flown = {each: rig.has(each) for each in before}
        assert flown == {name: 5.0, ceiling: 5.0}
        await onboard.restore(at_rest=())
        assert {each: rig.has(each) for each in before} == flown
        assert rig.fence_areas() == 1
        assert [step.restored for step in rig.record.steps] == [False, False]
        ((kind, text),) = rig.decided
        assert kind == "ERROR"
        assert text.startswith(
            "real still has the onboard configuration of this run: the guard does not confirm "
            "that it is disarmed, and in the air nothing is restored; the next start restores it, "
        )
        again = rig.onboard(PreflightPart(fence=None))
        await again.apply(rig.context)
        assert rig.has(ceiling) == before[ceiling]
        assert rig.fence_areas() == 0
        await again.restore(at_rest={"real"})
        assert {each: rig.has(each) for each in before} == before
        assert backups() == 0
        assert len(rig.decided) == 1

    with_vehicle(autopilot, script, params={name: 5.0})


def test_a_vehicle_that_may_be_in_the_air_and_was_not_changed_has_its_own() -> None:
    async def script(rig: Rig) -> None:
        onboard = rig.onboard()
        await onboard.apply(rig.context)
        await onboard.restore(at_rest=())
        assert [step.restored for step in rig.record.steps] == [True, True]
        assert rig.decided == []

    with_vehicle("px4", script, params={})


def test_a_vehicle_is_restored_although_another_one_cannot_be() -> None:
    """A backup that cannot be deleted (OSError) must not cut short what takes longer elsewhere."""
    restored: list[str] = []

    async def fail() -> None:
        raise OSError("disk failed")

    async def restore_slowly() -> None:
        await asyncio.sleep(1.0)
        restored.append("twin")

    async def run() -> None:
        setup: Any = SimpleNamespace(flown=lambda _: SimpleNamespace(attached="udpin://:14540"))
        anything: Any = SimpleNamespace(restored=lambda *_, **__: None)
        onboard = OnboardConfiguration(
            setup=setup, contexts=(), run_state=anything, record=anything, note=print
        )
        for name, undo in (("real", fail), ("twin", restore_slowly)):
            onboard._restorations[name] = restoration = Restoration()
            restoration._stack.push_async_callback(undo)
        with pytest.raises(OSError, match="disk failed"):
            await onboard.restore(at_rest={"real", "twin"})

    run_virtual(run())
    assert restored == ["twin"]


def test_a_log_that_cannot_be_written_is_noted_and_stops_no_other(tmp_path: Path) -> None:
    """As when the file of a broken download cannot be deleted: the verdict stands."""
    noted: list[tuple[str, str]] = []
    fetched: list[str] = []

    class Logs:
        def __init__(self, name: str) -> None:
            self._name = name

        async def list(self) -> tuple[LogEntry, ...]:
            return (LogEntry(1, 900, None),)

        async def fetch(self, _: LogEntry, folder: Path, *, name: str) -> Path:
            if name == "real":
                raise OSError(errno.EROFS, "Read-only file system", str(folder / "real-1.bin"))
            await asyncio.sleep(1.0)
            fetched.append(name)
            return folder / f"{name}-1.bin"

    _fetch_logs({name: Logs(name) for name in ("real", "twin")}, tmp_path, noted)
    assert fetched == ["twin"]
    assert noted == [
        ("real", f"the log cannot be fetched to {tmp_path}: Read-only file system"),
        ("twin", "twin-1.bin"),
    ]


@pytest.mark.parametrize(
    ("sizes_bytes", "said"),
    [
        ((900, 800), "real-2.bin"),
        ((700, 900, 0, 0), "real-2.bin (newer logs, all empty: 2)"),
        ((0, 0), "all 2 logs of the vehicle are empty"),
        ((), "the vehicle has no log"),
    ],
)
def test_an_empty_log_is_not_taken_for_that_of_the_flight(
    sizes_bytes: tuple[int, ...], said: str, tmp_path: Path
) -> None:
    class Logs:
        async def list(self) -> tuple[LogEntry, ...]:
            sizes = enumerate(sizes_bytes, start=1)
            return tuple(LogEntry(number, size, None) for number, size in sizes)

        async def fetch(self, entry: LogEntry, folder: Path, *, name: str) -> Path:
            return folder / f"{name}-{entry.number}.bin"

    noted: list[tuple[str, str]] = []
    _fetch_logs({"real": Logs()}, tmp_path, noted)
    assert noted == [("real", said)]


def _fetch_logs(logs: dict[str, Any], folder: Path, noted: list[tuple[str, str]]) -> None:
    """Fetch the logs of vehicles by name after a run in a folder, and note what is said."""

    def context(name: str) -> Any:
        onboard = SimpleNamespace(logs=logs[name])
        return SimpleNamespace(name=name, driver=SimpleNamespace(onboard=onboard))

    async def run() -> None:
        record = SimpleNamespace(vehicle_logs=True)
        setup: Any = SimpleNamespace(
            case=SimpleNamespace(record=record), order=SimpleNamespace(folder=folder)
        )
        anything: Any = SimpleNamespace()
        await OnboardConfiguration(
            setup=setup,
            contexts=tuple(map(context, logs)),
            run_state=anything,
            record=anything,
            note=lambda _, *, vehicle, text: noted.append((vehicle, text)),
        ).fetch_logs()

    run_virtual(run())


def backups() -> int:
    return len(list(parameter_backup_folder().glob("*")))
