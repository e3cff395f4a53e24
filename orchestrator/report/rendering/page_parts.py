"""Common parts of all pages: templates, style and script, and their Content-Security-Policy."""

import base64
import hashlib
from functools import cache
from importlib.resources import files

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from wil_campaign.orchestrator.report.model import PageImage
from wil_campaign.orchestrator.report.rendering.markup import shown_value
from wil_campaign.orchestrator.report.words import limit_text, number_text

_PACKAGE = "wil_campaign.orchestrator.report.rendering"


@cache
def page_environment(package: str = _PACKAGE) -> Environment:
    """Return the Jinja environment of the pages of a package: escaping, strict on undefined names.

    package: the one that has the folder `templates`.
    """
    created = Environment(
        loader=PackageLoader(package),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=shown_value,
    )
    created.filters["number"] = number_text
    created.filters["breakable"] = _breakable
    created.filters["data_uri"] = _data_uri
    created.filters["limit"] = limit_text
    return created


def render_template(
    name: str, *, script: str = "", package: str = _PACKAGE, **values: object
) -> str:
    """Return a whole page with style and script inline; everything from a file is escaped.

    script: the name of its file; empty for none. package: the one with the template. The page loads
    nothing from the network.
    """
    style, code = _resource("style.css"), _resource(script) if script else ""
    return (
        page_environment(package)
        .get_template(name)
        .render(
            policy=_policy(style, code),
            style=Markup(style),  # noqa: S704 - a file of this package
            script=Markup(code),  # noqa: S704 - a file of this package
            **values,
        )
    )


def _resource(name: str) -> str:
    return (files(_PACKAGE) / "templates" / name).read_text("utf-8")


def _policy(style: str, script: str) -> str:
    """Return the Content-Security-Policy: script and style by their hashes, no network."""
    return (
        "default-src 'none'; img-src data:; media-src 'self' file: data:; "
        f"style-src '{_hash(style)}'; script-src '{_hash(script)}'; "
        "base-uri 'none'; form-action 'none'"
    )


def _hash(text: str) -> str:
    digest = hashlib.sha256(text.encode()).digest()
    return "sha256-" + base64.b64encode(digest).decode("ascii")


def _breakable(name: str) -> Markup:
    """Return a name that a narrow column breaks after its underscores, not within its words."""
    return Markup("_<wbr>").join(name.split("_"))


def _data_uri(frame: PageImage) -> str:
    return f"data:image/webp;base64,{frame.webp}"
