"""What every page of ours has: files of this package, and a policy that permits nothing else."""

import base64
import hashlib
from importlib.resources import files

PACKAGE = "orchestrator.report.rendering"


def resource(name: str) -> str:
    """Return the text of a file beside the templates."""
    return (files(PACKAGE) / "templates" / name).read_text("utf-8")


def policy(style: str, script: str) -> str:
    """Return the Content-Security-Policy: our script and our style by their hashes, no network."""
    return (
        "default-src 'none'; img-src data:; media-src 'self' file: data:; "
        f"style-src '{_hash(style)}'; script-src '{_hash(script)}'; "
        "base-uri 'none'; form-action 'none'"
    )


def _hash(text: str) -> str:
    digest = hashlib.sha256(text.encode()).digest()
    return "sha256-" + base64.b64encode(digest).decode("ascii")
