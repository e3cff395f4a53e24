"""Signing: against pymavlink's own, the rules against replays, and a key that nobody sees."""

import asyncio
import base64
import hashlib
import pickle
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.plugins.signed_links.signed_link import SignedLink
from wil_campaign.plugins.signed_links.signer import (
    TICKS_PER_S,
    Signer,
    SigningCounts,
    ticks_of_utc,
)
from wil_campaign.plugins.signed_links.signing_key import (
    SigningKey,
    SigningKeyError,
    key_from_environment,
    key_from_file,
)
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.embedded.physics.config import EmbeddedConfig
from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle
from wil_campaign.vehicles.errors import IdentifyError
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.mavlink.framing import (
    FrameSplitter,
    MavlinkFrame,
    frame_checksum,
    frame_header,
)

SECRET = bytes(range(32))
KEY = SigningKey(SECRET)
NOW = ticks_of_utc(1_700_000_000.0)


def _frame(raw: bytes) -> MavlinkFrame:
    frame = frame_header(raw)
    assert frame is not None
    return frame


def _heartbeat(codec: MavlinkCodec) -> MavlinkFrame:
    return _frame(codec.pack(mavlink.MAVLink_heartbeat_message(2, 3, 81, 0, 3, 3)))


def _theirs(*, secret: bytes = SECRET, timestamp: int = NOW, sign: bool) -> Any:
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    mav.signing.secret_key = secret
    mav.signing.timestamp = timestamp
    mav.signing.link_id = 3
    mav.signing.sign_outgoing = sign
    return mav


MESSAGES = st.one_of(
    st.builds(
        lambda x, text: mavlink.MAVLink_statustext_message(x, text.encode()),
        st.integers(0, 7),
        st.text("abc", max_size=50),
    ),
    st.builds(
        lambda t, x: mavlink.MAVLink_local_position_ned_message(t, x, x, x, 0, 0, 0),
        st.integers(0, 2**32 - 1),
        st.floats(-1e3, 1e3, width=32),
    ),
    st.builds(
        lambda data: mavlink.MAVLink_log_data_message(1, 2, len(data), list(data.ljust(90, b"\0"))),
        st.binary(max_size=90),
    ),
)


@given(MESSAGES)
def test_pymavlink_believes_our_signatures(message: Any) -> None:
    codec = MavlinkCodec(system_id=245, component_id=190)
    plain = _frame(codec.pack(message))
    raw = Signer(key=KEY, link_id=7).sign(plain, NOW)
    assert raw is not None
    theirs = _theirs(sign=False)
    theirs.signing.allow_unsigned_callback = lambda *_: False
    decoded = theirs.decode(bytearray(raw))
    assert decoded.get_signed()
    assert decoded.get_link_id() == 7
    assert decoded.to_dict() == message.to_dict()
    # The frame is right for who does not know of signing as well.
    assert FrameSplitter().feed(raw)[0].raw == raw


@given(MESSAGES)
def test_we_believe_and_remove_signatures_of_pymavlink(message: Any) -> None:
    raw = bytes(message.pack(_theirs(sign=True)))
    bare = Signer(key=KEY).check(_frame(raw), NOW)
    plain = bytes(message.pack(_theirs(sign=False)))
    assert bare == plain


def test_a_message_that_no_dialect_knows_is_signed_with_a_right_checksum() -> None:
    body = bytes([3, 0, 0, 9, 1, 1, 0x55, 0x66, 0x07]) + b"abc"
    extra = b"\x2a"
    crc = frame_checksum(body, extra)
    plain = _frame(b"\xfd" + body + crc.to_bytes(2, "little"))
    raw = Signer(key=KEY).sign(plain, NOW)
    assert raw is not None
    covered = raw[1:-15]
    assert frame_checksum(covered, extra).to_bytes(2, "little") == raw[-15:-13]
    assert Signer(key=KEY).check(_frame(raw), NOW) == plain.raw


def test_another_key_is_bad() -> None:
    raw = Signer(key=SigningKey(bytes(32))).sign(
        _heartbeat(MavlinkCodec(system_id=1, component_id=1)), 5
    )
    assert raw is not None
    signer = Signer(key=KEY)
    assert signer.check(_frame(raw), 5) is None
    assert signer.counts == SigningCounts(bad=1)


@given(st.integers(0, 8 * 24 - 1))
def test_any_flipped_bit_is_noticed(bit: int) -> None:
    raw = Signer(key=KEY).sign(_heartbeat(MavlinkCodec(system_id=1, component_id=1)), NOW)
    assert raw is not None
    spoilt = bytearray(raw)
    at = 10 + bit // 8
    spoilt[at] ^= 1 << bit % 8
    header = frame_header(bytes(spoilt))
    assert header is not None
    assert Signer(key=KEY).check(header, NOW) is None


def test_unsigned_frames_are_refused_but_for_a_radios_status() -> None:
    signer, codec = Signer(key=KEY), MavlinkCodec(system_id=1, component_id=1)
    assert signer.check(_heartbeat(codec), NOW) is None
    status = _frame(codec.pack(mavlink.MAVLink_radio_status_message(1, 1, 1, 1, 1, 0, 0)))
    assert signer.check(status, NOW) == status.raw
    assert signer.counts == SigningCounts(unsigned=1)


def test_mavlink_1_cannot_be_signed() -> None:
    message = mavlink.MAVLink_heartbeat_message(2, 3, 81, 0, 3, 3)
    frame = _frame(bytes(message.pack(mavlink.MAVLink(None, 1, 1), force_mavlink1=True)))
    signer = Signer(key=KEY)
    assert signer.sign(frame, NOW) is None
    assert signer.check(frame, NOW) is None
    assert signer.counts == SigningCounts(unsigned=1, unsignable=1)


def _signed_at(stamp: int, *, system: int = 1, link_id: int = 0) -> MavlinkFrame:
    codec = MavlinkCodec(system_id=system, component_id=1)
    raw = Signer(key=KEY, link_id=link_id).sign(_heartbeat(codec), stamp)
    assert raw is not None
    return _frame(raw)


def test_a_replay_is_refused_each_stream_by_itself() -> None:
    signer = Signer(key=KEY)
    assert signer.check(_signed_at(NOW + 5), NOW) is not None
    for stamp in (NOW + 5, NOW + 4):
        assert signer.check(_signed_at(stamp), NOW) is None
    assert signer.check(_signed_at(NOW + 4, system=2), NOW) is not None
    assert signer.check(_signed_at(NOW + 4, link_id=1), NOW) is not None
    assert signer.check(_signed_at(NOW + 6), NOW) is not None
    assert signer.counts == SigningCounts(accepted=4, replayed=2)


def test_a_new_stream_may_be_a_minute_old_and_no_more() -> None:
    minute = 60 * TICKS_PER_S
    assert Signer(key=KEY).check(_signed_at(NOW - minute), NOW) is not None
    assert Signer(key=KEY).check(_signed_at(NOW - minute - 1), NOW) is None
    # One that was heard before is bound by itself alone.
    signer = Signer(key=KEY)
    assert signer.check(_signed_at(NOW), NOW) is not None
    assert signer.check(_signed_at(NOW + 1), NOW + 2 * minute) is not None


def test_timestamps_grow_and_follow_a_clock_that_is_ahead() -> None:
    signer, codec = Signer(key=KEY), MavlinkCodec(system_id=245, component_id=190)

    def stamp() -> int:
        raw = signer.sign(_heartbeat(codec), NOW)
        assert raw is not None
        return int.from_bytes(raw[-12:-6], "little")

    assert [stamp(), stamp()] == [NOW, NOW + 1]
    ahead = NOW + 3600 * TICKS_PER_S
    assert signer.check(_signed_at(ahead), NOW) is not None
    assert stamp() == ahead + 1
    assert Signer(key=KEY, newest=signer.newest).newest == ahead + 1


def _fly_signed(vehicle_key: SigningKey | None, our_key: SigningKey | None) -> Any:
    async def fly() -> Any:
        ours, theirs = memory_pair(latency_s=0.003)
        near = ours if our_key is None else SignedLink(link=ours, key=our_key, utc_s=1.7e9)
        far = (
            theirs
            if vehicle_key is None
            else SignedLink(link=theirs, key=vehicle_key, utc_s=1.7e9 + 30, link_id=1)
        )
        config = EmbeddedConfig(autopilot="px4")
        async with (
            EmbeddedVehicle(config=config, link=far, seed=1),
            Driver(name="real", link=near) as driver,
        ):
            await driver.identify(3.0)
            await driver.ready(30.0)
            await driver.arm()
            await asyncio.sleep(1.0)
            assert driver.state.armed
            return near

    return run_virtual(fly())


def test_a_signed_vehicle_is_flown() -> None:
    counts = _fly_signed(KEY, KEY).counts
    assert counts.accepted > 500
    assert counts.signed > 20
    assert (counts.unsigned, counts.bad, counts.replayed) == (0, 0, 0)


@pytest.mark.parametrize(
    ("vehicle_key", "words"),
    [
        (None, r"refused for its signature: \d+ unsigned frames"),
        (SigningKey(bytes(32)), r"refused for its signature: \d+ with a wrong signature frames"),
    ],
)
def test_a_vehicle_that_signs_otherwise_is_refused_in_words(
    vehicle_key: SigningKey | None, words: str
) -> None:
    with pytest.raises(IdentifyError, match=words):
        _fly_signed(vehicle_key, KEY)


def test_a_vehicle_that_wants_signatures_does_not_hear_us_without() -> None:
    with pytest.raises(IdentifyError, match="does not answer our requests"):
        _fly_signed(KEY, None)


@pytest.mark.parametrize(
    ("raw", "secret"),
    [
        (SECRET, SECRET),
        (SECRET.hex().encode() + b"\n", SECRET),
        (base64.b64encode(SECRET) + b"\n", SECRET),
        (b"passphrase: open sesame\n", hashlib.sha256(b"open sesame").digest()),
    ],
)
def test_forms_of_a_key(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, raw: bytes, secret: bytes
) -> None:
    file = tmp_path / "key"
    file.write_bytes(raw)
    wanted = SigningKey(secret).signature(b"frame")
    assert key_from_file(file).signature(b"frame") == wanted
    if b"\0" not in raw:
        monkeypatch.setenv("WIL_KEY", raw.decode())
        assert key_from_environment("WIL_KEY").signature(b"frame") == wanted


@pytest.mark.parametrize("raw", [b"", b"hunter2hunter2", b"\xff" * 31, b"passphrase:", b"zz" * 32])
def test_a_text_that_is_no_key_is_refused_and_not_shown(tmp_path: Path, raw: bytes) -> None:
    file = tmp_path / "key"
    file.write_bytes(raw)
    with pytest.raises(SigningKeyError, match="has no signing key") as caught:
        key_from_file(file)
    if raw:
        assert raw.decode(errors="replace") not in str(caught.value).replace("passphrase:WORDS", "")
        assert caught.value.__cause__ is None


def test_missing_keys_are_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("WIL_KEY", raising=False)
    with pytest.raises(SigningKeyError, match="WIL_KEY, which holds the signing key, is unset"):
        key_from_environment("WIL_KEY")
    with pytest.raises(SigningKeyError, match="No such file"):
        key_from_file(tmp_path / "none")


def test_the_key_is_not_shown() -> None:
    link = SignedLink(link=memory_pair()[0], key=KEY, utc_s=0.0)
    for text in (str(KEY), repr(KEY), repr([KEY]), f"{KEY}", repr(link), repr(vars(link))):
        assert SECRET.hex() not in text
        assert repr(SECRET) not in text
    with pytest.raises(TypeError, match="pickled"):
        pickle.dumps(KEY)
