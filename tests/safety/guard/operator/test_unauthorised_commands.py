"""Ten thousand commands of who has no right to give one: operator's socket, signed link."""

import asyncio
import os
import random
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.safety.guard.operator.test_operator_socket import Controller, ask
from wil_campaign.plugins.signed_links.signer import Signer, ticks_of_utc
from wil_campaign.plugins.signed_links.signing_key import SigningKey
from wil_campaign.vehicles.autopilots.autopilot import FlightMode, MavlinkTarget, command_long
from wil_campaign.vehicles.autopilots.px4 import Px4
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.mavlink.framing import frame_header

COMMANDS = 10_000
_NOBODY = 65534
_OTHER_USER = """
import json, os, socket, sys
path, count, user = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
os.setgroups([])
os.setgid(user)
os.setuid(user)
kinds, said = ("abort", "hold", "resume", "status", "watch"), {}
for number in range(count):
    with socket.socket(socket.AF_UNIX) as end:
        end.settimeout(20.0)
        try:
            end.connect(path)
            end.sendall(json.dumps({"command": kinds[number % 5], "who": "root"}).encode() + b"\\n")
            word = "answered" if end.recv(1000) else "closed"
        except PermissionError:
            word = "no permission"
        except ConnectionError:  # closed before all was said
            word = "closed"
    said[word] = said.get(word, 0) + 1
print(json.dumps(said, sort_keys=True))
"""


@pytest.fixture
def shared_folder() -> Iterator[Path]:
    """A folder that every user may enter, as no folder of pytest's is."""
    folder = Path(tempfile.mkdtemp(prefix="wil-"))
    folder.chmod(0o755)
    yield folder
    shutil.rmtree(folder)


async def _as_other_user(path: Path, count: int) -> str:
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-c", _OTHER_USER, str(path), str(count), str(_NOBODY)),
        stdout=asyncio.subprocess.PIPE,
    )
    out, _ = await process.communicate()
    return out.decode().strip()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can try it as another user")
async def test_another_user_gives_no_command_whatever_the_files_modes(shared_folder: Path) -> None:
    controller = Controller(shared_folder)
    async with controller.serve():
        assert await _as_other_user(controller.path, 10) == '{"no permission": 10}'
        controller.path.chmod(0o666)
        assert await _as_other_user(controller.path, COMMANDS) == f'{{"closed": {COMMANDS}}}'
        assert controller.obeyed == []
        assert set(controller.refused) == {"connection refused: it belongs to another user"}
        answer, _ = await ask(controller, "abort")
        await controller.close()
    assert answer["ok"]
    assert [one.kind for one in controller.obeyed] == ["abort"]


def test_a_command_without_a_right_signature_passes_no_signed_link() -> None:
    now = ticks_of_utc(1_700_000_000.0)
    key, other = SigningKey(bytes(range(32))), SigningKey(bytes(32))
    theirs, codec = Signer(key=key, link_id=3), MavlinkCodec(system_id=245, component_id=190)
    signer, forger, rng = Signer(key=key), Signer(key=other), random.Random(1)  # noqa: S311
    made = (
        lambda: command_long(MavlinkTarget(1), 400, 0.0, 21196.0),
        lambda: command_long(MavlinkTarget(1), 185, 1.0),
        lambda: Px4().set_mode(MavlinkTarget(1), FlightMode.LAND),
        lambda: mavlink.MAVLink_param_set_message(1, 1, b"COM_OBL_RC_ACT", 6.0, 9),
    )
    passed: Counter[str] = Counter()
    for number in range(COMMANDS):
        plain = codec.pack(made[number % len(made)]())
        frame = frame_header(plain)
        assert frame is not None
        right = theirs.sign(frame, now + number)
        wrong = forger.sign(frame, now + number)
        assert right is not None
        assert wrong is not None
        spoilt = bytearray(right)
        spoilt[-rng.randrange(1, 13)] ^= 1 << rng.randrange(8)  # of its time and signature
        for kind, raw in (
            ("unsigned", plain), ("of another key", wrong), ("spoilt", bytes(spoilt)),
            ("right", right), ("again", right),
        ):  # fmt: skip
            given = frame_header(raw)
            assert given is not None
            passed[kind] += signer.check(given, now + number) is not None
    assert passed == {
        "right": COMMANDS,
        "unsigned": 0,
        "of another key": 0,
        "spoilt": 0,
        "again": 0,
    }
