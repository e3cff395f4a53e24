r"""Signatures of MQTT messages: HMAC-SHA256 (RFC 2104) with a key that is never transmitted; pure.

A signed message is a JSON object whose last member is `signature`. It covers the whole topic, a
line feed, and the object as its bytes are without that member:

    HMAC-SHA256(key, topic + "\n" + '{"session": "...", "id": "a1", "at": 1763739601.2}')

Commands are signed with the operators' token itself, publications of the program with a key derived
from it: a holder of the derived key can verify statuses but cannot sign commands.
"""

import hmac
import json
import re
from collections.abc import Mapping
from typing import Any

_SIGNATURE = re.compile(rb'\s*,\s*"signature"\s*:\s*"([0-9a-f]{64})"\s*\}\s*\Z')
_SEARCHED_BYTES = 256
"""The signature member is searched in this many last bytes of the message."""


class SignatureError(ValueError):
    """A message without a signature, or with a wrong one; says which."""


def status_key(token: str) -> bytes:
    """Return the key for publications of the program."""
    return hmac.digest(token.encode(), b"wil status", "sha256")


def command_key(token: str) -> bytes:
    """Return the key for commands."""
    return token.encode()


def signed_message(topic: str, body: bytes, key: bytes) -> bytes:
    """Return a non-empty JSON object with its signature added as the last member."""
    signature = hmac.digest(key, _covered(topic, body), "sha256").hex()
    return body[:-1] + b', "signature": "' + signature.encode() + b'"}'


def signed_command(topic: str, fields: Mapping[str, Any], token: str) -> bytes:
    """Return a signed command, ready to publish."""
    return signed_message(
        topic, json.dumps(fields, ensure_ascii=False).encode(), command_key(token)
    )


def verified_message(topic: str, payload: bytes, key: bytes) -> bytes:
    """Return the signed object without its signature. Raises SignatureError."""
    begin = max(0, len(payload) - _SEARCHED_BYTES)
    match = _SIGNATURE.search(payload, begin)
    if match is None:
        raise SignatureError(
            "a signature is needed, as the last member of the object (see docs/operator.md)"
        )
    body = payload[: match.start()] + b"}"
    wanted = hmac.digest(key, _covered(topic, body), "sha256").hex().encode()
    if not hmac.compare_digest(match[1], wanted):
        raise SignatureError("wrong signature")
    return body


def _covered(topic: str, body: bytes) -> bytes:
    return topic.encode() + b"\n" + body
