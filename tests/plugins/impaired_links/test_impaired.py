"""The impaired link: each fault by itself, figures against the settings, the same luck again."""

import asyncio
import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.plugins.impaired_links.impaired import ImpairedLink
from wil_campaign.plugins.impaired_links.impairment import (
    BurstLoss,
    ImpairedDirection,
    Impairment,
    LinkOutage,
)
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec

PERIOD_S = 0.01


def _fly(impairment: Impairment, *, count: int = 3000, seed: int = 7) -> list[tuple[float, int]]:
    """Return (time of arrival, number) of frames sent each PERIOD_S."""

    async def fly() -> list[tuple[float, int]]:
        ours, theirs = memory_pair()
        link = ImpairedLink(
            link=ours,
            outgoing=impairment,
            incoming=Impairment(),
            rng=np.random.default_rng(seed),
        )
        codec, reader = (MavlinkCodec(system_id=1, component_id=1) for _ in range(2))
        arrived: list[tuple[float, int]] = []

        def take(data: bytes, t_s: float) -> None:
            arrived.extend((t_s, message.ts1) for message in reader.parse(data))

        theirs.receive(take)
        async with link, theirs:
            start_s = asyncio.get_running_loop().time()
            for number in range(count):
                link.write(codec.pack(mavlink.MAVLink_timesync_message(0, number + 1)))
                await asyncio.sleep(start_s + (number + 1) * PERIOD_S - _now_s())
            await asyncio.sleep(2.0)
        counts = link.outgoing
        assert counts.frames == count
        gone = counts.lost + counts.lost_in_outage + counts.overflowed
        assert counts.delivered == count - gone + counts.duplicated
        if not (impairment.duplicate and impairment.corrupt):
            assert len(arrived) == counts.delivered - counts.corrupted
        return arrived

    return run_virtual(fly())


def _now_s() -> float:
    return asyncio.get_running_loop().time()


def _delays_s(arrived: list[tuple[float, int]]) -> list[float]:
    return [t_s - (number - 1) * PERIOD_S for t_s, number in arrived]


def test_by_default_it_does_nothing() -> None:
    arrived = _fly(Impairment(), count=100)
    assert [number for _, number in arrived] == list(range(1, 101))
    assert max(_delays_s(arrived)) < 1e-9


def test_latency_and_jitter_keep_the_order() -> None:
    arrived = _fly(Impairment(latency_s=0.08, jitter_s=0.04))
    assert [number for _, number in arrived] == list(range(1, 3001))
    delays_s = _delays_s(arrived)
    assert min(delays_s) >= 0.04 - 1e-9
    assert max(delays_s) <= 0.12 + 1e-9
    # In order, a late frame holds up those behind it: the mean is above the latency.
    assert 0.08 < sum(delays_s) / len(delays_s) < 0.12


def test_the_share_of_lost_frames_is_the_requested_one() -> None:
    arrived = _fly(Impairment(loss=0.05), count=20_000)
    assert 1.0 - len(arrived) / 20_000 == pytest.approx(0.05, abs=0.006)


def test_bursts_have_their_length_and_share() -> None:
    arrived = _fly(Impairment(bursts=BurstLoss(length_s=0.05, gap_s=0.95)), count=20_000)
    there = {number for _, number in arrived}
    lost = [number not in there for number in range(1, 20_001)]
    runs = [len(list(run)) for gone, run in itertools.groupby(lost) if gone]
    # Seen each 10 ms, a burst of mean length 50 ms ends with this chance before the next frame.
    leave = 0.95 * (1.0 - math.exp(-PERIOD_S * (1.0 / 0.05 + 1.0 / 0.95)))
    assert sum(runs) / len(runs) == pytest.approx(1.0 / leave, rel=0.15)
    assert sum(lost) / len(lost) == pytest.approx(0.05, rel=0.25)


def test_a_burst_lasts_as_long_for_a_way_of_few_frames() -> None:
    bursts = BurstLoss(length_s=2.0, gap_s=3.0)
    assert bursts.chance_within(was_within=True, elapsed_s=0.0) == 1.0
    assert bursts.chance_within(was_within=True, elapsed_s=60.0) == pytest.approx(0.4)
    assert bursts.chance_within(was_within=False, elapsed_s=60.0) == pytest.approx(0.4)


def test_duplicates_come_behind_their_original() -> None:
    arrived = _fly(Impairment(duplicate=0.1))
    numbers = [number for _, number in arrived]
    assert numbers == sorted(numbers)
    assert len(numbers) - len(set(numbers)) == pytest.approx(300, abs=60)


def test_reordered_frames_are_overtaken() -> None:
    arrived = _fly(Impairment(reorder=0.1, reorder_by_s=0.025))
    numbers = [number for _, number in arrived]
    assert sorted(numbers) == list(range(1, 3001))
    late = [number for (_, number), delay_s in zip(arrived, _delays_s(arrived), strict=True)
            if delay_s > 0.02]  # fmt: skip
    assert len(late) == pytest.approx(300, abs=60)
    swapped = sum(after < before for before, after in itertools.pairwise(numbers))
    assert swapped > 150


def test_corrupted_frames_are_no_frames() -> None:
    # _fly counts that exactly the corrupted ones are missing.
    arrived = _fly(Impairment(corrupt=0.05), count=4000)
    assert len(arrived) == pytest.approx(3800, abs=60)


def test_bandwidth_delays_and_then_drops() -> None:
    size = len(
        MavlinkCodec(system_id=1, component_id=1).pack(mavlink.MAVLink_timesync_message(0, 300))
    )
    # Half of what is sent fits.
    rate = 8.0 * size / PERIOD_S / 2.0
    arrived = _fly(Impairment(bandwidth_bit_s=rate, queue_s=0.5), count=1000)
    steps_s = [after - before for (before, _), (after, _) in itertools.pairwise(arrived)]
    assert max(steps_s) <= 2.0 * PERIOD_S + 1e-6
    assert len(arrived) == pytest.approx(525, abs=10)
    assert 0.5 < max(_delays_s(arrived)) < 0.55


def test_an_outage_loses_the_frames_under_way() -> None:
    setting = Impairment(latency_s=0.1, outages=(LinkOutage(2.0, 3.0),))
    arrived = _fly(setting, count=1000)
    gone = sorted(set(range(1, 1001)) - {number for _, number in arrived})
    assert gone == list(range(gone[0], gone[-1] + 1))
    first_s, last_s = (gone[0] - 1) * PERIOD_S, (gone[-1] - 1) * PERIOD_S
    assert first_s == pytest.approx(1.9, abs=0.011)
    assert last_s == pytest.approx(4.99, abs=0.011)


def test_an_outage_on_demand_holds_both_ways() -> None:
    async def fly() -> tuple[list[Any], list[Any]]:
        ours, theirs = memory_pair()
        link = ImpairedLink(
            link=ours, outgoing=Impairment(), incoming=Impairment(), rng=np.random.default_rng(1)
        )
        here: list[Any] = []
        there: list[Any] = []
        reader_here, reader_there, codec = (
            MavlinkCodec(system_id=1, component_id=1) for _ in range(3)
        )
        link.receive(lambda data, _: here.extend(reader_here.parse(data)))
        theirs.receive(lambda data, _: there.extend(reader_there.parse(data)))
        async with link, theirs:
            for number in range(6):
                if number == 2:
                    link.start_outage(0.15)
                link.write(codec.pack(mavlink.MAVLink_timesync_message(0, number + 1)))
                theirs.write(codec.pack(mavlink.MAVLink_timesync_message(0, number + 1)))
                await asyncio.sleep(0.1)
        return [each.ts1 for each in here], [each.ts1 for each in there]

    assert run_virtual(fly()) == ([1, 2, 5, 6], [1, 2, 5, 6])


EVERYTHING = Impairment(
    latency_s=0.05,
    jitter_s=0.05,
    loss=0.1,
    bursts=BurstLoss(length_s=0.03, gap_s=0.5),
    duplicate=0.05,
    reorder=0.05,
    corrupt=0.05,
    bandwidth_bit_s=50_000.0,
    outages=(LinkOutage(3.0, 1.0),),
)


def test_the_same_seed_gives_the_same_arrivals() -> None:
    first = _fly(EVERYTHING, count=1000, seed=3)
    assert first == _fly(EVERYTHING, count=1000, seed=3)
    assert first != _fly(EVERYTHING, count=1000, seed=4)


def test_a_setting_does_not_shift_the_luck_of_another() -> None:
    lossy = {number for _, number in _fly(Impairment(loss=0.1))}
    setting = Impairment(loss=0.1, duplicate=0.2, latency_s=0.03, jitter_s=0.02, reorder=0.1)
    assert {number for _, number in _fly(setting)} == lossy


async def test_it_works_on_the_wall_clock() -> None:
    ours, theirs = memory_pair()
    setting = Impairment(latency_s=0.02, jitter_s=0.01)
    link = ImpairedLink(
        link=ours, outgoing=setting, incoming=Impairment(), rng=np.random.default_rng(1)
    )
    arrived: asyncio.Queue[float] = asyncio.Queue()
    theirs.receive(lambda _, t_s: arrived.put_nowait(t_s))
    async with link, theirs:
        sent_s = _now_s()
        link.write(
            MavlinkCodec(system_id=1, component_id=1).pack(mavlink.MAVLink_ping_message(1, 1, 0, 0))
        )
        async with asyncio.timeout(5.0):
            assert await arrived.get() - sent_s >= 0.01


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"loss": 1.5}, "loss is 1.5"),
        ({"latency_s": -1.0}, "latency_s is -1"),
        ({"latency_s": 0.01, "jitter_s": 0.02}, "before it was sent"),
        ({"bandwidth_bit_s": 0.0}, "bandwidth_bit_s is 0"),
        ({"corrupt": float("nan")}, "corrupt is nan"),
    ],
)
def test_impossible_settings_are_refused(fields: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Impairment(**fields)


def test_impossible_bursts_and_outages_are_refused() -> None:
    with pytest.raises(ValueError, match="length_s is 0"):
        BurstLoss(length_s=0.0, gap_s=1.0)
    with pytest.raises(ValueError, match=r"a blackout from 1\.0 s for 0\.0 s"):
        LinkOutage(1.0, 0.0)


@given(
    st.builds(
        Impairment,
        latency_s=st.floats(0.02, 1.0),
        jitter_s=st.floats(0.0, 0.02),
        loss=st.floats(0.0, 1.0),
        duplicate=st.floats(0.0, 1.0),
        reorder=st.floats(0.0, 1.0),
        corrupt=st.floats(0.0, 1.0),
        bandwidth_bit_s=st.none() | st.floats(100.0, 1e6),
    ),
    st.integers(0, 2**32),
)
def test_every_frame_is_accounted_for(impairment: Impairment, seed: int) -> None:
    way = ImpairedDirection(impairment=impairment, rng=np.random.default_rng(seed), opened_s=0.0)
    arrived = []
    for number in range(60):
        way.put(bytes([number] * 20), number * 0.05)
        arrived += way.take(number * 0.05)
    arrived += way.take(1e6)
    counts = way.counts
    assert way.next_due_s is None
    assert len(arrived) == counts.delivered
    assert counts.frames == 60
    assert counts.delivered == 60 + counts.duplicated - counts.lost - counts.overflowed
    assert all(len(frame) == 20 for frame in arrived)
