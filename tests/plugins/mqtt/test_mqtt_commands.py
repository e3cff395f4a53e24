"""Commands by MQTT: what is obeyed, what is refused, and that nothing makes the reader fall."""

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.plugins.mqtt.message_signing import (
    SignatureError,
    signed_message,
    status_key,
    verified_message,
)
from wil_campaign.plugins.mqtt.mqtt_commands import CommandReader, RefusedCommandError
from wil_campaign.safety.guard.core.operator_command import OperatorCommand

NOW_S = 1_763_739_600.0
TOKEN = "of the test"  # noqa: S105 - opens nothing
SESSION = "20261121T153936Z"


def make_reader() -> CommandReader:
    return CommandReader(
        base="wil/gate", token=TOKEN, session=SESSION, flying=lambda: ["large/wil/1"]
    )


def command_bytes(kind: str = "abort", *, token: str = TOKEN, **changes: Any) -> bytes:
    body = {"session": SESSION, "id": "a1", "at": NOW_S, "who": "anna", **changes}
    kept = {key: value for key, value in body.items() if value is not ...}
    return signed_message(f"wil/gate/operator/{kind}", json.dumps(kept).encode(), token.encode())


def read(payload: bytes, kind: str = "abort", *, retained: bool = False) -> Any:
    return make_reader().read(kind, payload, retained=retained, now_s=NOW_S)


@pytest.mark.parametrize("kind", ["abort", "hold", "resume"])
def test_a_good_command_is_obeyed(kind: str) -> None:
    asked = read(command_bytes(kind, reason="a bird", run="large/wil/1"), kind)
    assert (asked.kind, asked.command_id) == (kind, "a1")
    assert asked == OperatorCommand(
        kind,  # type: ignore[arg-type]
        "mqtt:anna",
        "a bird",
        command_id="a1",
        run="large/wil/1",
    )
    assert read(command_bytes(who=...)).who == "mqtt:operator"


@pytest.mark.parametrize(
    ("payload", "why"),
    [
        (b"", "not JSON"),
        (b"\xff\xfe", "not UTF-8"),
        (b"[" * 4000, "not JSON"),
        (b"[1]", "not a JSON object"),
        (b"{" + b" " * 66000 + b"}", "longer than 65536 bytes"),
        (b"{}", "a signature is needed"),
        (b'{"id": "a1", "signature": 5}', "a signature is needed"),
        (command_bytes()[:-3] + b'"}', "a signature is needed"),
        (command_bytes().replace(b'"}', b'", "x": 1}'), "a signature is needed"),
        (command_bytes(token="guess"), "wrong signature"),  # noqa: S106
        (command_bytes("hold"), "wrong signature"),
        (command_bytes().replace(b"anna", b"eve!"), "wrong signature"),
        (command_bytes(signature="x"), "unknown keys: signature"),
        (command_bytes(token_="of the test"), "unknown keys: token_"),  # noqa: S106
        (command_bytes(id=...), "id must be a text of 1 to 64"),
        (command_bytes(id="x" * 65), "id must be a text of 1 to 64"),
        (command_bytes(id=7), "id must be a text of 1 to 64"),
        (command_bytes(who="x\n"), "who must be a name of 1 to 64"),
        (command_bytes(more=1), "unknown keys: more"),
        (command_bytes("abort", **dict[str, Any]({"\ud800": 1})), "unknown keys: \\ud800"),
        (command_bytes(at=...), "at must be the time in seconds"),
        (command_bytes(at="now"), "at must be the time in seconds"),
        (command_bytes(at=True), "at must be the time in seconds"),
        (command_bytes(at=NOW_S - 5.1), "stale"),
        (command_bytes(at=NOW_S + 5.1), "stale"),
        (command_bytes(at=float("nan")), "stale"),
        (command_bytes(at=float("inf")), "stale"),
        (command_bytes(at=10**400), "stale"),
        (command_bytes(session=...), "for another session of the campaign"),
        (command_bytes(session="20261121T000000Z"), "for another session of the campaign"),
    ],
)
def test_a_wrong_command_is_refused_with_the_reason(payload: bytes, why: str) -> None:
    with pytest.raises(RefusedCommandError) as refused:
        read(payload)
    assert str(refused.value).startswith(why)


@pytest.mark.parametrize("run", ["large/wil/2", "", ["large"], None])
def test_a_run_that_is_not_in_flight_is_refused_but_for_an_abort(run: Any) -> None:
    for kind in ("hold", "resume"):
        with pytest.raises(RefusedCommandError, match="for a run that is not in flight"):
            read(command_bytes(kind, run=run), kind)
    assert read(command_bytes("abort", run=run)).run == "?"


@pytest.mark.parametrize("given", ["box: {}", {"box": {"up_m": [0, 2]}}])
def test_a_geofence_comes_as_text_or_as_an_object(given: Any) -> None:
    command = read(command_bytes("geofence", geofence=given), "geofence")
    assert (command.kind, command.command_id) == ("geofence", "a1")
    assert given in (command.document, json.loads(command.document) if given != "box: {}" else "")
    with pytest.raises(RefusedCommandError, match="geofence is required"):
        read(command_bytes("hold", geofence=given), "hold")
    with pytest.raises(RefusedCommandError, match="geofence is required"):
        read(command_bytes("geofence"), "geofence")


def test_half_a_surrogate_pair_is_no_text_of_a_geofence() -> None:
    """A command is encoded on its way to a guard or a node."""
    with pytest.raises(RefusedCommandError, match="geofence must be a text of whole characters"):
        read(command_bytes("geofence", geofence="box: \ud800"), "geofence")


def test_a_reason_that_is_fit_for_no_record_is_left_out() -> None:
    for reason in ("x" * 201, "\ud800", "a\nb", 7):
        assert read(command_bytes(reason=reason)).reason == ""


def test_a_retained_command_and_an_unknown_one_are_refused() -> None:
    with pytest.raises(RefusedCommandError, match="retained"):
        read(command_bytes(), retained=True)
    with pytest.raises(RefusedCommandError, match="no command 'land'"):
        read(command_bytes("land"), "land")


def test_no_id_is_obeyed_twice_while_it_is_fresh() -> None:
    reader = make_reader()
    reader.read("hold", command_bytes("hold"), retained=False, now_s=NOW_S)
    with pytest.raises(RefusedCommandError, match="used already") as refused:
        reader.read("hold", command_bytes("hold"), retained=False, now_s=NOW_S + 4.0)
    assert (refused.value.command_id, refused.value.who) == ("a1", "anna")
    with pytest.raises(RefusedCommandError, match="stale"):
        reader.read("hold", command_bytes("hold"), retained=False, now_s=NOW_S + 60.0)
    later = command_bytes("hold", at=NOW_S + 60.0)
    assert reader.read("hold", later, retained=False, now_s=NOW_S + 60.0).command_id == "a1"


def test_without_a_token_of_ours_there_is_no_reader() -> None:
    with pytest.raises(ValueError, match="anybody"):
        CommandReader(base="wil/gate", token="", session=SESSION, flying=list)


def test_an_unsigned_command_is_obeyed_where_a_campaign_has_no_key() -> None:
    reader = CommandReader(base="wil/gate", token=None, session=SESSION, flying=list)
    payload = json.dumps({"session": SESSION, "id": "a1", "at": NOW_S}).encode()
    assert reader.read("abort", payload, retained=False, now_s=NOW_S).kind == "abort"


def test_a_signature_is_for_one_campaign_and_for_one_command() -> None:
    body = b'{"state": "ended", "at": 1.5}'
    message = signed_message("wil/gate/status", body, status_key(TOKEN))
    assert json.loads(message)["state"] == "ended"
    assert verified_message("wil/gate/status", message, status_key(TOKEN)) == body
    for topic, key in (("wil/hall/status", status_key(TOKEN)), ("wil/gate/status", b"other")):
        with pytest.raises(SignatureError, match="wrong"):
            verified_message(topic, message, key)
    # Who can only check statuses cannot command.
    topic = "wil/gate/operator/abort"
    body = verified_message(topic, command_bytes(), TOKEN.encode())
    forged = signed_message(topic, body, status_key(TOKEN))
    with pytest.raises(RefusedCommandError, match="wrong signature"):
        read(forged)


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=6,
)
keys = st.sampled_from(["token", "signature", "session", "id", "at", "who", "run", "reason", "x"])


@given(st.binary(max_size=200) | st.dictionaries(keys, values).map(json.dumps).map(str.encode))
def test_garbage_is_refused_and_nothing_else_happens(payload: bytes) -> None:
    with pytest.raises(RefusedCommandError):
        read(payload)


@given(st.dictionaries(keys, values))
def test_garbage_with_the_right_signature_is_refused(body: dict[str, Any]) -> None:
    text = json.dumps({**body, "session": "another"}).encode()
    payload = signed_message("wil/gate/operator/abort", text, TOKEN.encode())
    with pytest.raises(RefusedCommandError):
        read(payload)
