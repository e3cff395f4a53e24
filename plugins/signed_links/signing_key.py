"""The key of MAVLink 2 signing: read from a file or the environment, never printed."""

import base64
import binascii
import hashlib
import hmac
import os
from pathlib import Path

from wil_campaign.vehicles.errors import VehicleError
from wil_campaign.vehicles.links.link_conditions import KeySource

KEY_BYTES = 32
_FORMS = (
    "32 bytes as they are, 64 hexadecimal digits, base64 of 32 bytes, or passphrase:WORDS, which "
    "is hashed as MAVProxy and Mission Planner do"
)
_PASSPHRASE = "passphrase:"  # noqa: S105 - a prefix


class SigningKeyError(VehicleError):
    """A signing key that is unavailable; the message never holds any of it."""


class SigningKey:
    """A signing key: 32 secret bytes, not in str() or repr(), never pickled."""

    __slots__ = ("_secret",)

    def __init__(self, secret: bytes) -> None:
        if len(secret) != KEY_BYTES:
            raise SigningKeyError(f"a signing key has {KEY_BYTES} bytes, not {len(secret)}")
        self._secret = secret

    def __repr__(self) -> str:
        return "SigningKey(hidden)"

    def __reduce__(self) -> str:
        raise TypeError("a signing key is not to be pickled")

    def signature(self, covered: bytes) -> bytes:
        """Return the key's six bytes that sign a frame up to its timestamp.

        https://mavlink.io/en/guide/message_signing.html
        """
        return hashlib.sha256(self._secret + covered).digest()[:6]

    def signed(self, covered: bytes, signature: bytes) -> bool:
        """Return whether the bytes were signed with this key."""
        return hmac.compare_digest(self.signature(covered), signature)


def signing_key(source: KeySource) -> SigningKey:
    """Return the signing key at a source. Raises SigningKeyError."""
    if source.kind == "file":
        return key_from_file(Path(source.name))
    return key_from_environment(source.name)


def key_from_file(path: Path) -> SigningKey:
    """Return the signing key in a file. Raises SigningKeyError."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        reason = error.strerror or "it cannot be read"
        raise SigningKeyError(f"signing key file {path}: {reason}") from error
    return _key(raw, f"signing key file {path}")


def key_from_environment(name: str) -> SigningKey:
    """Return the signing key in an environment variable. Raises SigningKeyError."""
    text = os.environ.get(name)
    if text is None:
        raise SigningKeyError(f"environment variable {name}, which holds the signing key, is unset")
    return _key(text.encode(), f"environment variable {name}")


def _key(raw: bytes, where: str) -> SigningKey:
    if len(raw) == KEY_BYTES:
        return SigningKey(raw)
    secret = _from_text(raw)
    if secret is None or len(secret) != KEY_BYTES:
        # The cause may quote the key, so it is dropped.
        raise SigningKeyError(f"{where} has no signing key; accepted are {_FORMS}") from None
    return SigningKey(secret)


def _from_text(raw: bytes) -> bytes | None:
    """Return the signing key in a text: hexadecimal, base64 or passphrase; None for others."""
    try:
        text = raw.decode().strip()
    except UnicodeDecodeError:
        return None
    if text.startswith(_PASSPHRASE):
        words = text.removeprefix(_PASSPHRASE).strip()
        return hashlib.sha256(words.encode()).digest() if words else None
    try:
        if len(text) == 2 * KEY_BYTES:
            return bytes.fromhex(text)
        return base64.b64decode(text, validate=True)
    except (ValueError, binascii.Error):
        return None
