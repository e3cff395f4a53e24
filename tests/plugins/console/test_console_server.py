"""The console's server: who gets in, who may command, and what is refused."""

import asyncio
import json
import time
from typing import Any

import pytest
from aiohttp import WSServerHandshakeError
from msgspec import structs

from tests.plugins.console.conftest import Console
from wil_campaign.plugins.console.console_access import Role
from wil_campaign.plugins.console.console_address import (
    ConsoleAddress,
    ConsoleError,
    require_safe_console_address,
)
from wil_campaign.plugins.console.console_server import POLICY
from wil_campaign.plugins.console.feed.feed_messages import (
    EventView,
    FactsView,
    ImageView,
    RunView,
    VehicleView,
)
from wil_campaign.plugins.console.page_commands import MAX_BODY_BYTES
from wil_campaign.plugins.console.playback import Playback

FLOOD = 10_000
BURST = 100


async def test_a_link_is_good_once_and_its_cookie_is_strict(console: Console) -> None:
    client = await console.client()
    asked = {"token": console.access.invite("operator"), "name": "anna"}
    first = await console.post(client, "/session", asked)
    cookie = first.headers["Set-Cookie"]
    assert (first.status, "HttpOnly" in cookie, "SameSite=Strict" in cookie) == (200, True, True)
    again = await console.post(client, "/session", asked)
    assert (again.status, "already used" in (await again.json())["text"]) == (403, True)


async def test_commands_take_the_operators_path_with_a_name(console: Console) -> None:
    client = await console.client("operator")
    for command in ("hold", "resume", "abort"):
        done = await console.post(client, "/command", {"command": command})
        assert (done.status, (await done.json())["ok"]) == (200, True)
    assert console.commands() == [(one, "console:anna") for one in ("hold", "resume", "abort")]
    assert [(record["command"], record["who"], record["ok"]) for record in console.records()] == [
        (one, "console:anna", True) for one in ("hold", "resume", "abort")
    ]


async def test_a_command_that_comes_too_late_is_refused_but_an_abort(console: Console) -> None:
    """As after a link that was down: its page has long said that the command was not confirmed."""
    client = await console.client("operator")
    long_ago_s = time.monotonic() - 11.0
    for command in ("hold", "resume", "geofence"):
        body: dict[str, object] = {"command": command, "seen_s": long_ago_s}
        body |= {"geofence": "box: {}"} if command == "geofence" else {}
        late = await console.post(client, "/command", body)
        said = (await late.json())["text"]
        assert (late.status, "more than 10 s ago" in said) == (403, True)
    unknown = await console.post(client, "/command", {"command": "hold", "seen_s": None})
    assert unknown.status == 403
    assert console.commands() == []
    abort = await console.post(client, "/command", {"command": "abort", "seen_s": long_ago_s})
    assert (abort.status, console.commands()) == (200, [("abort", "console:anna")])


async def test_a_status_says_when_it_was_sent(console: Console) -> None:
    client = await console.client("viewer")
    console.hub.show_status({"campaigns": [], "guards": [], "problem": ""})
    socket_ = await client.ws_connect("/live", headers={"Origin": console.origin})
    while (message := await socket_.receive_json())["type"] != "status":
        pass
    assert 0.0 <= time.monotonic() - message["sent_s"] < 5.0


async def test_one_operator_has_control_and_every_operator_may_abort(console: Console) -> None:
    anna = await console.client("operator")
    ben = await console.client("operator", "ben")
    viewer = await console.client("viewer", "eve")
    held = await console.post(ben, "/command", {"command": "hold"})
    assert (held.status, (await held.json())["text"]) == (
        403,
        "hold: anna has control; take control first",
    )
    for command in ("abort", "hold"):
        assert (await console.post(viewer, "/command", {"command": command})).status == 403
    assert (await console.post(viewer, "/control", {})).status == 403
    assert (await console.post(viewer, "/invite", {"role": "operator"})).status == 403
    assert console.commands() == []
    assert (await console.post(ben, "/control", {})).status == 200
    assert (await console.post(ben, "/command", {"command": "hold"})).status == 200
    assert (await console.post(anna, "/command", {"command": "resume"})).status == 403
    assert (await console.post(anna, "/command", {"command": "abort"})).status == 200
    assert console.commands() == [("hold", "console:ben"), ("abort", "console:anna")]


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Host": "evil.example"},
        {"Content-Type": "text/plain"},
    ],
)
async def test_another_sites_request_is_refused(console: Console, headers: dict[str, str]) -> None:
    client = await console.client("operator")
    done = await console.post(client, "/command", {"command": "abort"}, **headers)
    assert (done.status, console.commands()) == (403, [])
    if "Content-Type" not in headers:
        with pytest.raises(WSServerHandshakeError, match="403"):
            await client.ws_connect("/live", headers={"Origin": console.origin, **headers})
    if "Host" in headers:
        assert (await client.get("/", headers=headers)).status == 403


async def test_the_web_socket_needs_origin_and_session(console: Console) -> None:
    stranger = await console.client()
    with pytest.raises(WSServerHandshakeError, match="403"):
        await stranger.ws_connect("/live", headers={"Origin": console.origin})
    client = await console.client("viewer")
    with pytest.raises(WSServerHandshakeError, match="403"):
        await client.ws_connect("/live")
    socket_ = await client.ws_connect("/live", headers={"Origin": console.origin})
    assert (await socket_.receive_json())["you"]["role"] == "viewer"


@pytest.mark.parametrize(
    ("body", "status"),
    [
        (b"", 403),
        (b"{", 403),
        (b"\xff", 403),
        (b"[" * 30_000, 403),
        (b"[]", 403),
        (b'{"command": "arm"}', 403),
        (b'{"command": "abort", "force": true}', 403),
        (b'{"command": "geofence"}', 403),
        (b'{"command": "abort", "geofence": "box: {}"}', 403),
        (b" " * (MAX_BODY_BYTES + 1), 413),
    ],
)
async def test_a_request_that_is_no_command_is_refused(
    console: Console, body: bytes, status: int
) -> None:
    client = await console.client("operator")
    done = await console.post(client, "/command", body)
    assert (done.status, (await done.json())["ok"]) == (status, False)
    assert console.commands() == []


async def test_runs_in_flight_cannot_be_paused(console: Console) -> None:
    roles: tuple[Role, ...] = ("operator", "viewer")
    for role in roles:
        done = await console.post(await console.client(role), "/playback", {"paused": True})
        assert (done.status, "in flight" in (await done.json())["text"]) == (403, True)


@pytest.mark.parametrize(("role", "status"), [("operator", 200), ("viewer", 403)])
async def test_an_operator_alone_pauses_a_finished_run(
    console: Console, role: Role, status: int
) -> None:
    playback = console.pages.playback = Playback(time=lambda: 0.0)
    done = await console.post(await console.client(role), "/playback", {"paused": True})
    assert (done.status, playback.state()["paused"]) == (status, status == 200)


@pytest.mark.parametrize("body", [b"{}", b'{"role": "admin"}', b'{"role": ["viewer"]}'])
async def test_a_link_of_no_role_is_refused(console: Console, body: bytes) -> None:
    client = await console.client("operator")
    done = await console.post(client, "/invite", body)
    assert (done.status, (await done.json())["ok"]) == (403, False)


SQUARE = [[-1, -1], [5, -1], [5, 1], [-1, 1]]
CROSSED = [[-1, -1], [5, 1], [5, -1], [-1, 1]]
BESIDE = [[-1, 3], [5, 3], [5, 4], [-1, 4]]


@pytest.mark.parametrize(
    ("corners", "up_m", "said"),
    [
        (SQUARE, [-0.5, 2.0], ""),
        (CROSSED, [-0.5, 2.0], "cross"),
        (BESIDE, [-0.5, 2.0], "real would be"),
        (SQUARE, [-0.5, 0.4], "real would be"),
        (SQUARE, [2.0, 1.0], "geofence: "),
        ([[0, 0]], [-0.5, 2.0], "polygon"),
    ],
)
async def test_a_fence_is_checked_before_it_is_sent(
    console: Console, corners: list[list[int]], up_m: list[float], said: str
) -> None:
    client = await console.client("operator")
    vehicle = VehicleView(
        name="real",
        armed=True,
        mode="HOLD",
        landed="in_air",
        link_up=True,
        failsafe=False,
        position_ned_m=(1.0, 0.0, -1.0),
    )
    await console.hub.receive(structs.replace(view(1.0), vehicles=(vehicle,)))
    text = json.dumps({"include": [{"polygon": corners}], "up_m": up_m})
    done = await console.post(client, "/command", {"command": "geofence", "geofence": text})
    reply = await done.json()
    assert (done.status, said in reply["text"]) == (403 if said else 200, True)
    assert [(one.kind, one.document) for one in console.fleet.told] == (
        [] if said else [("geofence", text)]
    )


async def test_no_command_of_an_unauthorised_flood_is_accepted(console: Console) -> None:
    await console.client()
    host = console.origin.removeprefix("http://")
    reader, writer = await asyncio.open_connection(*host.split(":"))
    answered = 0
    for number in range(FLOOD // BURST):
        body = json.dumps({"command": ("abort", "hold")[number % 2]})
        writer.write(
            BURST
            * (
                f"POST /command HTTP/1.1\r\nHost: {host}\r\nOrigin: {console.origin}\r\n"
                f"Cookie: session={number}\r\nContent-Type: application/json\r\n"
                f"Content-Length: {len(body)}\r\n\r\n{body}"
            ).encode()
        )
        for _ in range(BURST):
            head = await reader.readuntil(b"\r\n\r\n")
            assert head.startswith(b"HTTP/1.1 403 ")
            await reader.readexactly(int(head.lower().partition(b"content-length: ")[2].split()[0]))
            answered += 1
    writer.close()
    assert (answered, console.commands()) == (FLOOD, [])
    # It is recorded, and fills no disk.
    assert 1 <= len(console.records()) < 1000
    assert {record["who"] for record in console.records()} == {"console"}


async def test_a_page_that_sends_anything_but_acknowledgements_is_closed(console: Console) -> None:
    client = await console.client("operator")
    for sent in ("abort", "x" * 5000):
        page = await client.ws_connect("/live", headers={"Origin": console.origin})
        await page.send_str(sent)
        while not page.closed:
            await page.receive(5.0)
        assert page.close_code in {1008, 1009}
    assert console.commands() == []


async def test_the_page_asks_for_nothing_elsewhere(console: Console) -> None:
    client = await console.client()
    page = await client.get("/")
    assert page.headers["Content-Security-Policy"] == POLICY
    assert "default-src 'none'" in POLICY
    assert page.headers["X-Content-Type-Options"] == "nosniff"
    text = await page.text()
    assert "http" not in text.replace("http://www.w3.org/2000/svg", "")
    assert (await client.get("/page/../console_server.py")).status == 404
    assert (await client.get("/page/console_server.py")).status == 404
    assert (await client.post("/page/main.js", headers={"Origin": console.origin})).status == 405


def event(number: int) -> EventView:
    return EventView("/r", number, 1.0, "vehicle", "text", "real", "<b>PreArm</b>", 4)


def view(t_s: float) -> RunView:
    return RunView(
        run="/r",
        name="large/wil/1",
        clock="wall",
        subject="real",
        t_s=t_s,
        stage="goal",
        entered_s={},
        events={},
        verdict_so_far="PASS",
        reason="",
        held=False,
        vehicles=(),
        margins=(),
        mixings=(),
        fences={},
    )


async def test_a_page_gets_what_is_known_and_then_what_is_new(console: Console) -> None:
    image = ImageView("/r", "real", 7, 1.0, 0.05, 640, 480, rendered=True, jpeg=b"jpeg")
    for message in (event(1), event(2), FactsView("/r", {"case": "large"}), view(1.0), image):
        await console.hub.receive(message)
    client = await console.client("viewer", "eve")
    page = await client.ws_connect("/live", headers={"Origin": console.origin})
    found = [await page.receive() for _ in range(7)]
    documents = [json.loads(one.data) for one in found[:6]]
    assert [document["type"] for document in documents] == [
        *("hello", "scene", "event", "event", "people", "run")
    ]
    assert [document["number"] for document in documents[2:4]] == [1, 2]
    data: bytes = found[6].data
    length = int.from_bytes(data[:4], "big")
    assert json.loads(data[4 : 4 + length])["seq"] == 7
    assert data[4 + length :] == b"jpeg"
    await console.hub.receive(view(float("nan")))
    assert json.loads((await page.receive()).data)["t_s"] is None


async def test_a_later_page_receives_who_gave_which_command_and_when(console: Console) -> None:
    anna = await console.client("operator")
    before_s = time.time()
    assert (await console.post(anna, "/command", {"command": "abort"})).status == 200
    viewer = await console.client("viewer", "eve")
    page = await viewer.ws_connect("/live", headers={"Origin": console.origin})
    await page.receive()
    told = json.loads((await page.receive()).data)
    assert (told["type"], told["command"], told["who"], told["ok"]) == (
        *("command", "abort", "anna"),
        True,
    )
    assert before_s <= told["at_s"] <= time.time()


def head_of(data: bytes) -> Any:
    """Return what stands before an image."""
    return json.loads(data[4 : 4 + int.from_bytes(data[:4], "big")])


async def test_images_wait_for_a_page_and_only_the_newest_is_kept(console: Console) -> None:
    client = await console.client("viewer")
    page = await client.ws_connect("/live", headers={"Origin": console.origin})
    for seq in range(50):
        await console.hub.receive(
            ImageView("/r", "real", seq, 1.0, 0.0, 4, 4, rendered=True, jpeg=b"x")
        )
        await asyncio.sleep(0.001)
    await console.hub.receive(event(1))
    seen: list[int] = []
    while True:
        message = await page.receive(5.0)
        if isinstance(message.data, bytes):
            length = int.from_bytes(message.data[:4], "big")
            seen.append(json.loads(message.data[4 : 4 + length])["seq"])
        elif json.loads(message.data)["type"] == "event":
            break
    assert len(seen) == 2
    # Another camera's image does not wait for those.
    other = ImageView("/r", "mixed", 7, 1.0, 0.0, 4, 4, rendered=True, jpeg=b"x")
    await console.hub.receive(other)
    assert head_of((await page.receive(5.0)).data)["name"] == "mixed"
    await page.send_str('{"ack": 1}')
    assert head_of((await page.receive(5.0)).data)["seq"] == 49
    # What never was on its way cannot be acknowledged.
    await page.send_str('{"ack": 1}')
    while not page.closed:
        await page.receive(5.0)
    assert page.close_code == 1008


@pytest.mark.parametrize("text", ["0.0.0.0", "192.168.1.4:8000", "[::]:1", "hall.example"])  # noqa: S104
def test_an_address_that_others_reach_needs_tls(text: str) -> None:
    with pytest.raises(ConsoleError):
        require_safe_console_address(ConsoleAddress.parse(text), tls=False)


@pytest.mark.parametrize("text", ["", "127.0.0.1", ":8000", "localhost:1", "[::1]:8000"])
def test_loopback_is_safe_without_tls(text: str) -> None:
    require_safe_console_address(ConsoleAddress.parse(text), tls=False)


@pytest.mark.parametrize("text", ["a b", "host:99999", "http://127.0.0.1:1", ":x"])
def test_a_text_that_is_no_console_address_is_refused(text: str) -> None:
    with pytest.raises(ConsoleError, match="not a console address"):
        ConsoleAddress.parse(text)
