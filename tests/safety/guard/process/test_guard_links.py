"""The links that the guard's process holds: made worse, gone dark, signed."""

import asyncio
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.ports import free_port
from tests.safety.guard.remote_rigs import ROOT, RemoteFlight, guard_config, until
from wil_campaign.plugins.impaired_links.impaired import Radio
from wil_campaign.plugins.impaired_links.impairment import BurstLoss, Impairment, LinkOutage
from wil_campaign.plugins.redundant_links.redundant import Redundancy
from wil_campaign.plugins.signed_links.signed_link import SignedLink
from wil_campaign.plugins.signed_links.signing_key import key_from_environment
from wil_campaign.safety.guard.core.commands import BringDown, StartOutage
from wil_campaign.safety.guard.core.events import GuardedVehicle, GuardSettings
from wil_campaign.safety.guard.process.guard_config import (
    GuardConfig,
    GuardConfigError,
    GuardedVehicleConfig,
)
from wil_campaign.safety.guard.process.remote_guard import RemoteGuard
from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget, own_heartbeat
from wil_campaign.vehicles.autopilots.px4 import Px4
from wil_campaign.vehicles.links.link import LinkError
from wil_campaign.vehicles.links.link_conditions import KeySource, LinkConditions
from wil_campaign.vehicles.links.link_strings import parse_link
from wil_campaign.vehicles.links.udp import UdpLink
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec

KEY = "passphrase:of the test"


@pytest.fixture(autouse=True)
def _runtime(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    folder = Path(tempfile.mkdtemp(prefix="wil-"))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    yield
    shutil.rmtree(folder)


def more_of_the_twin(flight: RemoteFlight) -> Callable[[], bool]:
    """Return whether five more frames of the twin have come since this call."""
    twin = flight.heard["twin"]
    return lambda: flight.heard["twin"] >= twin + 5


async def test_one_link_goes_dark_for_a_while_and_the_other_does_not(tmp_path: Path) -> None:
    late = Impairment(latency_s=0.02)
    conditions = LinkConditions(air=(Radio(outgoing=late, incoming=late, seed=(0,)),))
    settings = GuardSettings(orchestrator_silent_s=5.0, vehicle_lost_s=30.0)
    async with RemoteFlight(tmp_path, conditions=conditions, settings=settings) as flight:
        flight.guard.send(StartOutage("real", 6.0))
        # Meanwhile the guard has begun it, and what was under way has come.
        await until(more_of_the_twin(flight))
        dark = flight.heard["real"]
        await until(more_of_the_twin(flight))
        assert flight.heard["real"] == dark
        await until(lambda: flight.heard["real"] > dark)
        flight.guard.send(BringDown("done"))
        assert await flight.guard.all_down(60.0)


def signed_config(folder: Path, port: int) -> GuardConfig:
    return GuardConfig(
        run="test",
        folder=str(folder),
        epoch_s=time.time() - time.monotonic(),
        vehicles={
            "real": GuardedVehicleConfig(
                vehicle=GuardedVehicle(autopilot=Px4(), target=MavlinkTarget(1), attached=True),
                link=f"udpin://127.0.0.1:{port}",
                conditions=LinkConditions(signing=KeySource("environment", "WIL_TEST_KEY")),
            )
        },
    )


async def test_the_guard_signs_and_believes_only_what_is_signed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WIL_TEST_KEY", KEY)
    port = free_port()
    guard = RemoteGuard(guard_config=signed_config(tmp_path, port))
    inside: list[str] = []
    ours = MavlinkCodec(system_id=245, component_id=190)
    link = guard.link("real")
    link.receive(lambda data, _: inside.extend(m.get_type() for m in ours.parse(data)))
    address = parse_link(f"udpout://127.0.0.1:{port}")
    vehicle, stranger = (MavlinkCodec(system_id=1, component_id=1) for _ in range(2))
    signed = SignedLink(
        link=UdpLink(address=address), key=key_from_environment("WIL_TEST_KEY"), utc_s=time.time()
    )
    answers: list[str] = []
    signed.receive(lambda data, _: answers.extend(m.get_type() for m in vehicle.parse(data)))
    async with link, guard:
        async with UdpLink(address=address) as unsigned:
            for _ in range(5):
                unsigned.write(stranger.pack(own_heartbeat()))
                await asyncio.sleep(0.02)
        await asyncio.sleep(0.2)
        assert inside == []
        async with signed:
            signed.write(vehicle.pack(own_heartbeat()))
            await until(lambda: inside == ["HEARTBEAT"])
            # Taken by a link that believes only what is signed, and answered there.
            async with asyncio.timeout(20.0):
                while "HEARTBEAT" not in answers:
                    signed.write(vehicle.pack(own_heartbeat()))
                    link.write(ours.pack(own_heartbeat()))
                    await asyncio.sleep(0.1)
    assert "of the test" not in (tmp_path / "guard.jsonl").read_text()


async def test_a_rival_at_a_vehicle_s_port_is_an_event_of_its_own(tmp_path: Path) -> None:
    port = free_port()
    config = signed_config(tmp_path, port)
    plain = replace(config.vehicles["real"], conditions=LinkConditions())
    guard = RemoteGuard(guard_config=replace(config, vehicles={"real": plain}))
    address = parse_link(f"udpout://127.0.0.1:{port}")
    link = guard.link("real")
    link.receive(lambda *_: None)
    codecs = [MavlinkCodec(system_id=1, component_id=1) for _ in range(2)]
    async with link, guard, UdpLink(address=address) as one, UdpLink(address=address) as other:
        async with asyncio.timeout(20.0):
            while not any(event.kind == "rival" for event in guard.events):
                for sender, codec in zip((one, other), codecs, strict=True):
                    sender.write(codec.pack(own_heartbeat()))
                await asyncio.sleep(0.05)
    (rival,) = [event for event in guard.events if event.kind == "rival"]
    assert rival.vehicle == "real"
    assert rival.text.startswith("system 1 sends from 127.0.0.1:")


async def test_a_key_that_is_not_there_is_named_and_nothing_begins(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match=r"environment variable WIL_TEST_KEY.* is unset"):
        async with RemoteGuard(guard_config=signed_config(tmp_path, free_port())):
            raise AssertionError("began without a key")


_times = st.floats(0.0, 5.0)
_chances = st.floats(0.0, 1.0)
_impairments = st.builds(
    Impairment,
    latency_s=st.floats(1.0, 5.0),
    jitter_s=st.floats(0.0, 1.0),
    loss=_chances,
    bursts=st.none() | st.builds(BurstLoss, length_s=st.floats(0.1, 5), gap_s=st.floats(0.1, 5)),
    duplicate=_chances,
    bandwidth_bit_s=st.none() | st.floats(100.0, 1e6),
    outages=st.lists(st.builds(LinkOutage, _times, st.floats(0.1, 3.0))).map(tuple),
)
_radios = st.builds(
    Radio,
    outgoing=_impairments,
    incoming=_impairments,
    seed=st.lists(st.integers(0, 2**63), min_size=1).map(tuple),
)
_conditions = st.builds(
    LinkConditions,
    air=st.lists(_radios | st.just(Redundancy()), max_size=2).map(tuple),
    signing=st.none() | st.builds(KeySource, st.sampled_from(["file", "environment"]), st.text()),
)


@given(_conditions)
def test_a_guard_config_carries_the_conditions_of_its_links(conditions: LinkConditions) -> None:
    sent = guard_config(Path("/run"), conditions=conditions)
    assert GuardConfig.unpacked(sent.packed()).vehicles["real"].conditions == conditions


def test_a_guard_config_carries_the_spare_links() -> None:
    sent = guard_config(Path("/run"))
    spares = ("udpin://0.0.0.0:14550", "serial:///dev/ttyUSB0:57600")
    real = replace(sent.vehicles["real"], link="udpin://0.0.0.0:14540", spares=spares)
    there = GuardConfig.unpacked(replace(sent, vehicles={"real": real}).packed())
    assert there.vehicles["real"].spares == spares


IMPORTS = """
import sys
from wil_campaign.safety.guard.process import guard_process
from wil_campaign.vehicles.links.link_factory import open_link
from wil_campaign.vehicles.links.link_strings import parse_link
open_link(parse_link("udpin://127.0.0.1:14540"))
print(*(name for name in sys.modules if "plugins." in name and "_links." in name))
"""


def test_a_guard_of_udp_links_imports_no_other_kind() -> None:
    """It starts in 0.4 s of CPU, which each run on the wall clock waits for."""
    command = [sys.executable, "-P", "-c", IMPORTS]
    done = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603 - ours
    plugins = {"stream_links", "impaired_links", "redundant_links", "signed_links"}
    assert set(done.stdout.split()) == {f"wil_campaign.plugins.{name}.plugin" for name in plugins}


def test_impossible_conditions_are_no_guard_config() -> None:
    radio = Radio(outgoing=Impairment(), incoming=Impairment(), seed=(0,))
    sent = guard_config(Path("/run"), conditions=LinkConditions(air=(radio,)))
    plain = msgspec.msgpack.decode(sent.packed())
    plain["vehicles"]["real"]["conditions"]["air"][0]["outgoing"]["loss"] = 2.0
    with pytest.raises(GuardConfigError, match="loss is 2"):
        GuardConfig.unpacked(msgspec.msgpack.encode(plain))
