r"""Signatures of MQTT messages: HMAC-SHA256 (RFC 2104) by a key that is never on the wire; pure.

A signed message is a JSON object whose last member is `signature`. It covers the whole topic, a
line feed, and the object as its bytes are without that member:

    HMAC-SHA256(key, topic + "\n" + '{"session": "...", "id": "a1", "at": 1763739601.2}')

Commands are signed by the operators' token itself, what the program publishes by a key made from
it: who has only that one can check statuses, and not command.
"""

import hmac
import json
import re
from collections.abc import Mapping
from typing import Any

_SIGNATURE = re.compile(rb'\s*,\s*"signature"\s*:\s*"([0-9a-f]{64})"\s*\}\s*\Z')
_SEARCHED_BYTES = 256
"""The member stands within so many bytes of the end."""


class SignatureError(ValueError):
    """A message without a signature, or with a wrong one; says which."""


def status_key(token: str) -> bytes:
    """Return the key of what the program publishes."""
    return hmac.digest(token.encode(), b"wil status", "sha256")


def command_key(token: str) -> bytes:
    """Return the key of commands."""
    return token.encode()


def signed(topic: str, body: bytes, key: bytes) -> bytes:
    """Return a JSON object, which has members, with its signature as the last one."""
    signature = hmac.digest(key, _covered(topic, body), "sha256").hex()
    return body[:-1] + b', "signature": "' + signature.encode() + b'"}'


def signed_command(topic: str, said: Mapping[str, Any], token: str) -> bytes:
    """Return a command as it is published."""
    return signed(topic, json.dumps(said, ensure_ascii=False).encode(), command_key(token))


def verified(topic: str, payload: bytes, key: bytes) -> bytes:
    """Return the object that was signed, without its signature. Raises SignatureError."""
    begin = max(0, len(payload) - _SEARCHED_BYTES)
    found = _SIGNATURE.search(payload, begin)
    if found is None:
        raise SignatureError(
            "a signature is needed, as the last member of the object (see docs/operator.md)"
        )
    body = payload[: found.start()] + b"}"
    wanted = hmac.digest(key, _covered(topic, body), "sha256").hex().encode()
    if not hmac.compare_digest(found[1], wanted):
        raise SignatureError("wrong signature")
    return body


def _covered(topic: str, body: bytes) -> bytes:
    return topic.encode() + b"\n" + body
