"""What every page of ours has: its templates, files, and a policy that permits nothing else."""

import base64
import hashlib
from functools import cache
from importlib.resources import files

from jinja2 import Environment, PackageLoader, StrictUndefined

from orchestrator.report.model import Frame
from orchestrator.report.rendering.markup import shown
from orchestrator.report.words import limit_text, number_text

_PACKAGE = "orchestrator.report.rendering"


@cache
def environment() -> Environment:
    """Return what our pages' templates are filled by: escaped, nothing undefined, our filters."""
    made = Environment(
        loader=PackageLoader(_PACKAGE),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=shown,
    )
    made.filters["number"] = number_text
    made.filters["data_uri"] = _data_uri
    made.filters["limit"] = limit_text
    return made


def resource(name: str) -> str:
    """Return the text of a file beside the templates."""
    return (files(_PACKAGE) / "templates" / name).read_text("utf-8")


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


def _data_uri(frame: Frame) -> str:
    return f"data:image/jpeg;base64,{frame.jpeg}"
