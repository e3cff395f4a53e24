"""Live views of plugins beside a flight: what one that fails costs."""

from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import pytest

from wil_campaign.hooks import LiveViewError
from wil_campaign.orchestrator.cli import live_views
from wil_campaign.orchestrator.cli.live_views import views_beside


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What users are told beside two views, of which the second cannot be closed."""
    lines: list[str] = []

    @contextmanager
    def view(address: str, say: Any, **_: Any) -> Iterator[None]:
        if address == "dark":
            raise RuntimeError("no lamp")
        try:
            yield
        finally:
            say(f"{address} closes")
            if address == "bad":
                raise RuntimeError("the window is gone")

    known = {name: SimpleNamespace(beside=name) for name in ("window", "ticker")}
    monkeypatch.setattr(live_views, "plugin_additions", lambda _: known)
    monkeypatch.setattr(live_views, "absent_additions", lambda _: {})
    monkeypatch.setattr(live_views, "load_plugin_object", lambda _: view)
    monkeypatch.setattr(live_views, "given_options", lambda views: views)
    return lines


def test_a_view_that_raises_before_the_flight_is_named_with_its_plugin(
    shown: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    sonar = SimpleNamespace(name="sonar", origin="wil-sonar 1.2", adds={"live_views": ("ticker",)})
    monkeypatch.setattr(live_views, "installed_plugins_by_name", lambda: (sonar,))
    views: Any = {"window": "good", "ticker": "dark"}
    with pytest.raises(LiveViewError) as raised, views_beside(views, shown.append):
        shown.append("the flight")
    assert raised.value.code == 2
    said = "--ticker: the view of the plugin sonar (wil-sonar 1.2) cannot be opened: RuntimeError: "
    assert str(raised.value).startswith(f"{said}no lamp; mend it")
    assert shown == ["good closes"]


VIEWS: Any = {"window": "good", "ticker": "bad"}


def test_a_view_that_cannot_be_closed_is_named_and_loses_nothing(shown: list[str]) -> None:
    with views_beside(VIEWS, shown.append):
        shown.append("the flight")
    fault = "--ticker: the view cannot be closed: RuntimeError: the window is gone"
    assert shown == ["the flight", "bad closes", fault, "good closes"]


def test_a_fault_of_the_flight_is_not_hidden_by_a_view(shown: list[str]) -> None:
    with pytest.raises(ValueError, match="in flight"), views_beside(VIEWS, shown.append):
        raise ValueError("in flight")
    assert shown[-1] == "good closes"
