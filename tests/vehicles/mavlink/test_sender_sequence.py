"""One sender on a bad link is one, and two with the same ids are two, whatever their numbers."""

import random
from collections.abc import Iterable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wil_campaign.vehicles.mavlink.framing import MavlinkFrame
from wil_campaign.vehicles.mavlink.vehicle_frames import SenderSequence

Sent = tuple[float, str, MavlinkFrame]


def frames(who: str, count: int, *, first: int, period_s: float, from_s: float = 0.0) -> list[Sent]:
    """Return what a sender sends, numbered, each frame with other bytes."""
    return [
        (
            from_s + number * period_s,
            who,
            MavlinkFrame(
                f"{who}{number}".encode(), 32, 1, 1, (first + number) % 256, 2, signed=False
            ),
        )
        for number in range(count)
    ]


def split(sent: Iterable[Sent]) -> tuple[SenderSequence, list[bytes], list[bytes]]:
    sequence = SenderSequence()
    own: list[bytes] = []
    others: list[bytes] = []
    for t_s, _, frame in sorted(sent, key=lambda one: one[0]):
        mine, second = sequence.split(frame, t_s)
        own += [one.raw for one in mine]
        others += [one.raw for one in second]
    return sequence, own, others


@pytest.mark.parametrize("period_s", [0.002, 0.01, 0.1, 1.0])
def test_sound_link_passes_all_at_once_and_in_order(period_s: float) -> None:
    sent = frames("a", 600, first=200, period_s=period_s)
    sequence, own, others = split(sent)
    assert own == [frame.raw for _, _, frame in sent]
    assert (others, sequence.are_two) == ([], False)


@settings(max_examples=60)
@given(
    seed=st.integers(0, 10**6),
    lost=st.floats(0.0, 0.6),
    doubled=st.floats(0.0, 0.3),
    jitter_s=st.floats(0.0, 0.03),
    period_s=st.sampled_from([0.005, 0.01, 0.04]),
)
def test_one_sender_on_a_bad_link_is_one(
    seed: int, lost: float, doubled: float, jitter_s: float, period_s: float
) -> None:
    rng = random.Random(seed)  # noqa: S311 - repeatable
    sent: list[Sent] = []
    for t_s, who, frame in frames("a", 1500, first=rng.randrange(256), period_s=period_s):
        if rng.random() < lost:
            continue
        sent.append((t_s + rng.uniform(0.0, jitter_s), who, frame))
        if rng.random() < doubled:
            sent.append((t_s + rng.uniform(0.0, jitter_s), who, frame))
    sequence, own, others = split(sent)
    assert not sequence.are_two
    assert len(others) <= 0.05 * len(sent)
    assert len(own) + len(others) >= len(sent) - 12  # the last may still be held


@settings(max_examples=60)
@given(
    seed=st.integers(0, 10**6),
    apart=st.integers(9, 40),
    lost=st.floats(0.0, 0.3),
    period_s=st.sampled_from([0.005, 0.01, 0.04]),
)
def test_one_sender_whose_frames_overtake_many_others_is_one(
    seed: int, apart: int, lost: float, period_s: float
) -> None:
    """Half of them are late by up to so many numbers, as by a radio that repeats what was lost."""
    rng = random.Random(seed)  # noqa: S311 - repeatable
    sent = [
        (t_s + rng.choice([0.0, rng.uniform(0.0, apart * period_s)]), who, frame)
        for t_s, who, frame in frames("a", 1500, first=rng.randrange(256), period_s=period_s)
        if rng.random() >= lost
    ]
    sequence, own, others = split(sent)
    assert not sequence.are_two
    assert len({*own, *others}) == len(own) + len(others) >= len(sent) - 60  # may still be held
    assert len(others) <= 0.05 * len(sent)


@pytest.mark.parametrize("seed", range(4))
def test_short_outages_of_a_fast_sender_make_no_second_one(seed: int) -> None:
    """After one the mean period is long for a while, in which all its numbers come again."""
    rng = random.Random(seed)  # noqa: S311 - repeatable
    sent: list[Sent] = []
    out_until_s = 0.0
    for t_s, who, frame in frames("a", 12_000, first=7, period_s=0.001):
        if rng.random() < 0.0005:
            out_until_s = t_s + 0.09
        if t_s >= out_until_s:
            sent.append((t_s + rng.uniform(0.0, 0.012), who, frame))
    sequence, own, others = split(sent)
    assert not sequence.are_two
    assert len(others) <= 0.002 * len(sent)
    assert len(own) + len(others) >= len(sent) - 12


@pytest.mark.parametrize("gap", [9, 40, 128, 200, 255, 256])
@pytest.mark.parametrize("outage_s", [0.05, 0.3, 5.0])
def test_outage_holds_up_nothing_for_long(gap: int, outage_s: float) -> None:
    before = frames("a", 100, first=0, period_s=0.01)
    after = frames("a", 100, first=100 + gap, period_s=0.01, from_s=1.0 + outage_s)
    after = [(t_s, who, frame._replace(raw=b"b" + frame.raw)) for t_s, who, frame in after]
    sequence, own, others = split([*before, *after])
    assert not sequence.are_two
    assert len(others) <= 1  # a number that just came
    assert own == [one.raw for _, _, one in (*before, *after) if one.raw not in others]


def test_vehicle_that_reboots_at_once_is_still_the_sender() -> None:
    before = frames("a", 500, first=7, period_s=0.01)
    after = frames("b", 500, first=0, period_s=0.01, from_s=5.0)
    sequence, own, others = split([*before, *after])
    assert (len(own), others, sequence.are_two) == (1000, [], False)


@settings(max_examples=60)
@given(
    offset=st.integers(0, 255),
    second_period_s=st.sampled_from([0.007, 0.01, 0.013, 0.1]),
    shift_s=st.floats(0.0, 0.01),
    lost=st.sampled_from([0.0, 0.1]),
)
def test_two_senders_are_two_and_the_first_one_stays_the_sender(
    offset: int, second_period_s: float, shift_s: float, lost: float
) -> None:
    rng = random.Random(offset)  # noqa: S311 - repeatable
    first = frames("a", 1000, first=0, period_s=0.01)
    count = round(5.0 / second_period_s)
    second = frames("b", count, first=500 + offset, period_s=second_period_s, from_s=5.0 + shift_s)
    sent = [one for one in (*first, *second) if rng.random() >= lost]
    sequence = SenderSequence()
    passed = 0
    for t_s, _, frame in sorted(sent, key=lambda one: one[0]):
        own, _ = sequence.split(frame, t_s)
        if sequence.are_two:
            break
        passed += sum(one.raw.startswith(b"b") for one in own)
    assert sequence.are_two
    assert t_s < 5.0 + max(1.0, 20 * second_period_s)
    near = min(offset, 256 - offset) <= 80  # numbers that are the first one's own, by chance
    assert passed == 0 or near


def test_first_frames_of_a_second_sender_in_flight_do_not_pass() -> None:
    """A board that is switched on: a burst in one packet, and then its streams."""
    first = frames("a", 1000, first=100, period_s=0.008)
    burst = frames("b", 20, first=0, period_s=0.0, from_s=4.001)
    then = frames("b", 300, first=20, period_s=0.008, from_s=4.1)
    sequence, own, others = split([*first, *burst, *then])
    assert [raw for raw in own if raw.startswith(b"b")] == []
    assert len(others) == 320
    assert sequence.are_two


def test_second_sender_is_none_once_the_first_is_silent() -> None:
    first = frames("a", 300, first=0, period_s=0.01)
    second = frames("b", 900, first=100, period_s=0.01, from_s=0.005)
    sequence, own, _ = split([*first, *second])
    assert sequence.are_two
    assert [raw for raw in own if raw.startswith(b"b")] == []
