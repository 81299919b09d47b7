"""The pages in a real browser: no error, no request beyond the file, no sideways scrolling."""

from pathlib import Path

import pytest
from control_folders import with_control
from report_folders import FLEET, empty_machine, machine

from pipeline.report.pages import write_report
from tests.browser import foreign, look, needs_browser, requests

pytestmark = needs_browser
HOSTILE = "<script>document.title='owned'</script>" + "W" * 120


@pytest.fixture(scope="module")
def pages(tmp_path_factory) -> list[Path]:
    root = tmp_path_factory.mktemp("browser")
    fleet = [
        machine(root, "mill01", days=3),
        machine(root, "hostile", program=HOSTILE, state=HOSTILE, description=HOSTILE, days=3),
        with_control(
            machine(root, "lathe", "recorded", days=3, passed=False, credit="Records: Test Works")
        ),
        empty_machine(
            root, "new_mill", "recorded", submodels=("spindle",), missing=((HOSTILE, HOSTILE),)
        ),
    ]
    write_report(fleet, FLEET, None, root / "out")
    return sorted((root / "out").glob("*.html"))


def test_pages_load_nothing_else_and_report_no_error(browser, pages):
    assert len(pages) == 17
    for page in pages:
        look(browser, page, 1280, "light")
        urls = requests(browser)
        assert page.as_uri() in urls  # the log does see requests
        assert foreign(urls) == []
        assert browser.get_log("browser") == []
        assert browser.title != "owned"


@pytest.mark.parametrize("width", [380, pytest.param(768, marks=pytest.mark.proof), 1280])
def test_no_page_scrolls_sideways_with_everything_unfolded(browser, pages, width):
    for page in pages:
        look(browser, page, width, "light")
        beyond = browser.execute_script(
            "return document.documentElement.scrollWidth - document.documentElement.clientWidth"
        )
        assert beyond <= 0, f"{page.name} is {beyond} px too wide at {width} px"


def test_figures_follow_the_theme(browser, pages):
    page = next(p for p in pages if p.stem == "mill01_records")
    seen = {}
    for scheme in ("light", "dark"):
        look(browser, page, 1280, scheme)
        seen[scheme] = browser.execute_script(
            "const c = (s, p) => getComputedStyle(document.querySelector(s))[p];"
            "return [c('body', 'backgroundColor'), c('.plot .grid', 'stroke'),"
            " c('.plot text', 'fill'), c('.plot .s-active', 'fill')]"
        )
    assert all(a != b for a, b in zip(seen["light"], seen["dark"], strict=True))


def test_words_in_figures_keep_their_size_on_a_phone(browser, pages):
    page = next(p for p in pages if p.stem == "mill01_records")
    look(browser, page, 380, "light")
    heights = browser.execute_script(
        "return [...document.querySelectorAll('.plot text')]"
        ".map(e => e.getBoundingClientRect().height)"
    )
    assert len(heights) > 10
    assert min(heights) >= 11  # px; a line of 12 px type
