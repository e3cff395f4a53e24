"""The page in a browser, from a file: no error, no request, cursor, sorting, keys."""

from collections.abc import Iterator

import pytest

from tests.orchestrator.report.browser import Page, browser, chromium
from tests.orchestrator.report.recorded_campaign import too_high, write_campaign
from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.orchestrator.report.campaign_report import write_report

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


@pytest.fixture(scope="module")
def high(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """The page of a campaign whose run of mode wil was too high from the goal on."""
    folder = write_campaign(tmp_path_factory.mktemp("high") / "gate")
    (folder / "large/wil/1/result.json").write_text(to_json(too_high()))
    with browser() as opened:
        opened.resize(1280, 900)
        opened.open(write_report(folder).path.as_uri())
        opened.settle()
        show(opened, "run-large-wil-1")
        yield opened


def show(page: Page, fragment: str) -> None:
    page.value(f"location.hash = '{fragment}'")
    page.settle()


def test_the_page_works_by_itself(page: Page) -> None:
    for fragment in ("overview", "run-large-wil-1", "run-large-sim-1"):
        show(page, fragment)
    assert page.errors == []
    assert [request for request in page.requests if not request.startswith("data:")] == []
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


@pytest.mark.parametrize("width_px", [1440, 820, 390])
def test_no_word_of_the_margins_is_broken(page: Page, width_px: int) -> None:
    page.resize(width_px, 900)
    show(page, "run-large-sim-1")
    table = "document.querySelector('#run-large-sim-1 .margins')"
    page.value(f"void ({table}.querySelector('td').textContent = 'at most 1234.567 m of it')")
    heads = f"[...{table}.querySelectorAll('th:first-child')]"
    lines = page.value(f"{heads}.map((one) => one.getBoundingClientRect().height / 20)")
    page.resize(1280, 900)
    # A name may take a second line, at its underscore.
    assert lines
    assert max(lines) < 3.5, lines


def test_an_image_says_what_it_shows_and_that_it_can_be_enlarged(page: Page) -> None:
    show(page, "run-large-wil-1")
    button = "document.querySelector('#run-large-wil-1 .saw .main button.enlarge')"
    page.send("Accessibility.enable")
    found = page.send("Runtime.evaluate", expression=button)["result"]["objectId"]
    tree = page.send("Accessibility.getPartialAXTree", objectId=found, fetchRelatives=False)
    name = tree["nodes"][0]["name"]["value"]
    assert name.startswith("enlarge: mixed image, exposed")
    # What is written on the image is said, too.
    assert "gate" in name


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


def test_the_cursor_reads_no_value_where_the_curve_is_broken(page: Page) -> None:
    show(page, "run-large-wil-1")
    run = "document.querySelector('#run-large-wil-1')"
    curve = f"{run}.querySelector('.plot path.curve')"
    whole = page.value(f"{curve}.getAttribute('d')")
    # The page shows 0.5 s to 6 s: 3.25 s is in the middle, in a gap of 0.11 s.
    places = [f"{x},500" for x in range(0, 1001, 10) if x != 500]
    joined, broken = f"M{' '.join(places)}", f"M{' '.join(places[:50])} M{' '.join(places[50:])}"
    found = []
    for drawn in (joined, broken):
        page.value(f"{curve}.setAttribute('d', '{drawn}'), delete {curve}.wilPoints")
        page.value(f"{run}.querySelector('.timeline').focus()")
        page.press("Home")
        for _ in range(15):
            page.press("ArrowLeft")
        found.append(page.value(f"{run}.querySelector('.plot output').textContent"))
    assert float(found[0]) > 0.0
    assert found[1] == "\N{EN DASH}"
    page.value(f"{curve}.setAttribute('d', '{whole}'), delete {curve}.wilPoints")
    assert page.errors == []


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
    for fragment in ("overview", "run-large-wil-1", "run-large-sim-1"):
        show(page, fragment)
        assert page.value("document.documentElement.scrollWidth") == 390
        # Neither does a part of it scroll sideways.
        parts = "[...document.querySelectorAll('.scroll, .strip')].filter((one) => one.clientWidth)"
        wide = f"{parts}.filter((one) => one.scrollWidth > one.clientWidth + 1).length"
        assert page.value(wide) == 0
    background = page.value("getComputedStyle(document.body).backgroundColor")
    assert (background == "rgb(18, 22, 27)") == dark
    page.resize(1280, 900)


def test_the_violated_limit_is_drawn_over_its_interval_with_the_part_beyond(high: Page) -> None:
    run = "document.querySelector('#run-large-wil-1 .closeup"
    said = high.value(f"{run} figcaption').innerText")
    assert "at most 1 m, +0.00 s to +1.50 s" in said
    assert "worst 1.2 m" in said
    # The interval of 1.5 s of what is shown, 1 s before it to 1.5 s after it.
    line = f"{run} line.limit').getBoundingClientRect().width"
    assert high.value(f"{line} / {run} svg.chart').clientWidth") == pytest.approx(0.375, abs=0.01)
    area = f"{run} .excess polygon').getBoundingClientRect().height"
    assert high.value(f"{area} / {run} svg.chart').clientHeight") > 0.2
    assert high.value(f"{run}').getBoundingClientRect().bottom") < 900


def test_marks_lie_on_the_image_at_every_width(page: Page) -> None:
    frame = "document.querySelector('#run-large-wil-1 .saw .main"
    for width_px in (1440, 390):
        page.resize(width_px, 900)
        show(page, "run-large-wil-1")
        for side in ("left", "top", "right", "bottom"):
            places = [
                page.value(f"{frame} {part}').getBoundingClientRect().{side}")
                for part in ("img", "svg.marks")
            ]
            assert places[0] == pytest.approx(places[1], abs=0.6)
    page.resize(1280, 900)
    said = page.value("document.querySelector('#run-large-wil-1 .marks-list').innerText")
    assert "gate" in said
    assert "from the body" in said


def test_a_frame_is_enlarged_by_click_and_by_keyboard(page: Page) -> None:
    show(page, "run-large-wil-1")
    frames = "document.querySelectorAll('#run-large-wil-1 .strip button.enlarge')"
    shown = "document.querySelector('dialog img').alt"
    is_open = "document.querySelector('dialog').open"
    page.value(f"{frames}[2].click()")
    page.settle()
    assert page.value(is_open)
    small = page.value(f"{frames}[2].querySelector('img').getBoundingClientRect().width")
    assert page.value("document.querySelector('dialog img').clientWidth") > 1.5 * small
    before = page.value(shown)
    page.press("ArrowRight")
    assert page.value(shown) == page.value(f"{frames}[3].querySelector('img').alt") != before
    page.press("ArrowLeft")
    assert page.value(shown) == before
    page.value("document.querySelector('dialog').close()")
    page.settle()
    assert page.value("location.hash") == "#run-large-wil-1"
    page.value(f"{frames}[4].focus()")
    page.value("document.activeElement.click()")
    page.settle()
    # Keys of the page do nothing behind an enlarged frame.
    page.press("o")
    assert page.value("location.hash") == "#run-large-wil-1"
    page.value("document.querySelector('dialog').close()")
    assert page.errors == []


def test_a_table_that_is_cut_at_the_right_says_so(page: Page) -> None:
    table = "document.querySelector('#run-large-wil-1 .scroll')"
    show(page, "overview")
    show(page, "run-large-wil-1")
    found = []
    for width in ("3000px", ""):
        page.value(f"{table}.querySelector('table').style.minWidth = '{width}'")
        page.value("window.dispatchEvent(new Event('resize'))")
        found.append(page.value(f"{table}.classList.contains('wide')"))
    assert found == [True, False]


def test_on_a_phone_each_cell_stands_under_the_head_of_its_column(page: Page) -> None:
    page.resize(390, 844)
    show(page, "run-large-wil-1")
    cell = "document.querySelector('#run-large-wil-1 .scroll tbody td')"
    label = page.value(f"getComputedStyle({cell}, '::before').content")
    page.resize(1280, 900)
    assert label == '"vehicle"'


def test_an_image_that_is_shown_again_is_that_of_the_moment(page: Page) -> None:
    run = "document.querySelector('#run-large-wil-1"
    assert page.value(f"{run} .strip .now img').src === {run} .saw .main img').src")


def test_the_panel_and_the_cursor_say_one_latency(page: Page) -> None:
    show(page, "overview")
    show(page, "run-large-wil-1")
    run = "document.querySelector('#run-large-wil-1"
    page.value(f"{run} .timeline').focus()")
    page.press("Home")
    figures = page.value(f"{run} .saw > dl').innerText")
    plots = f"[...{run}').querySelectorAll('.plot')]"
    latency = f"{plots}.find((one) => one.innerText.startsWith('latency')).querySelector('output')"
    assert float(page.value(f"{latency}.textContent")) == 50.0
    assert "50 ms" in figures
    assert "exposure skew" in figures
