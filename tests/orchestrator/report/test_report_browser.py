"""The page in a browser, from a file: no error, no request, cursor, sorting, keys."""

from collections.abc import Iterator

import pytest

from orchestrator.report.campaign_report import write_report
from tests.orchestrator.report.browser import Page, browser, chromium
from tests.orchestrator.report.recorded_campaign import write_campaign

pytestmark = pytest.mark.skipif(chromium() is None, reason="chromium is not installed")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    folder = write_campaign(tmp_path_factory.mktemp("results") / "gate")
    written = write_report(folder)
    with browser() as opened:
        opened.resize(1280, 900)
        opened.open(written.path.as_uri())
        opened.settle()
        yield opened


def show(page: Page, fragment: str) -> None:
    page.value(f"location.hash = '{fragment}'")
    page.settle()


def test_the_page_works_by_itself(page: Page) -> None:
    for fragment in ("overview", "run-large-wil-1", "run-large-sim-1"):
        show(page, fragment)
    assert page.errors == []
    assert [one for one in page.requests if not one.startswith("data:")] == []
    # The check can fail: what the policy forbids is seen as an error.
    page.value(
        "void document.body.append(Object.assign(new Image(), {src: 'http://127.0.0.1:9/'}))"
    )
    page.settle()
    assert any("Content Security Policy" in error for error in page.errors)
    page.errors.clear()


def test_a_failed_run_names_its_cause_in_the_first_screen(page: Page) -> None:
    show(page, "run-large-wil-1")
    bottom = "getBoundingClientRect().bottom"
    run = "document.querySelector('#run-large-wil-1"
    for part in (" .violated", " .why dl:last-child", " .saw img"):
        assert 0 < page.value(f"{run}{part}').{bottom}") < 900
    assert "collision of real" in page.value(f"{run} .first').innerText")
    assert page.value("getComputedStyle(document.querySelector('#overview')).display") == "none"


def test_a_phone_shows_violation_image_and_command_without_scrolling(page: Page) -> None:
    page.resize(390, 844)
    show(page, "run-large-wil-1")
    run = "document.querySelector('#run-large-wil-1"
    commanded = f"[...{run}').querySelectorAll('dt')].find((one) => one.textContent == 'commanded')"
    bottoms = [f"{run}{part}')" for part in (" .violated", " .saw .main img")] + [commanded]
    shown = [page.value(f"{one}.getBoundingClientRect().bottom") for one in bottoms]
    page.resize(1280, 900)
    assert all(0 < bottom < 844 for bottom in shown), shown


def test_one_cursor_moves_in_all_plots_and_maps(page: Page) -> None:
    show(page, "run-large-wil-1")
    run = "document.querySelector('#run-large-wil-1')"
    page.value(f"{run}.querySelector('.timeline').focus()")
    page.press("Home")
    assert page.value(f"{run}.querySelector('.clock').textContent") == "2.00 s"
    assert float(page.value(f"{run}.querySelector('.plot output').textContent")) < 0.1
    places = f"[...{run}.querySelectorAll('.cursor')].map((one) => one.getAttribute('x1'))"
    spots = f"[...{run}.querySelectorAll('.spot')].map((one) => one.getAttribute('cx'))"
    before, spots_before = page.value(places), page.value(spots)
    assert len(set(before)) == 1
    for _ in range(20):
        page.press("ArrowLeft")
    assert page.value(f"{run}.querySelector('.clock').textContent") == "1.00 s"
    assert set(page.value(places)) != set(before)
    assert page.value(spots) != spots_before


def test_keys_lead_from_run_to_run(page: Page) -> None:
    show(page, "overview")
    hashes = []
    for key in ("j", "j", "k", "n", "o"):
        page.press(key)
        page.settle()
        hashes.append(page.value("location.hash"))
    sim, wil = "#run-large-sim-1", "#run-large-wil-1"
    assert hashes == [sim, wil, sim, wil, "#overview"]


def test_tables_are_sorted_by_their_heads(page: Page) -> None:
    show(page, "overview")
    rows = (
        "[...document.querySelectorAll('table.runs tbody tr')].map((r) => r.cells[1].textContent)"
    )
    press = "document.querySelectorAll('table.runs thead button')[1].click()"
    page.value(press)
    assert page.value(rows) == ["sim", "wil"]
    page.value(press)
    assert page.value(rows) == ["wil", "sim"]


@pytest.mark.parametrize("dark", [False, True])
def test_nothing_is_wider_than_a_phone(page: Page, *, dark: bool) -> None:
    page.resize(390, 844, dark=dark)
    for fragment in ("overview", "run-large-wil-1"):
        show(page, fragment)
        assert page.value("document.documentElement.scrollWidth") == 390
    background = page.value("getComputedStyle(document.body).backgroundColor")
    assert (background == "rgb(18, 22, 27)") == dark
    page.resize(1280, 900)
