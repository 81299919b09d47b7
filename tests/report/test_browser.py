"""The pages in a real browser: no error, no request beyond the file, no sideways scrolling."""

from pathlib import Path

import pytest
from control_folders import with_control
from optimise_documents import optimised, part
from report_folders import FLEET, empty_machine, machine

from pipeline.report.optimised.page import write_optimised_page
from pipeline.report.pages import write_report
from tests.browser import foreign, look, needs_browser, requests

pytestmark = needs_browser
OPTIMISED = "optimised.html"
HOSTILE = "<script>document.title='owned'</script>" + "W" * 120


@pytest.fixture(scope="module")
def page(pages: list[Path]) -> Path:
    """The page of an optimised program."""
    return next(one for one in pages if one.name == OPTIMISED)


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
    document = part(optimised(300, columns=900, name=HOSTILE))
    write_optimised_page(document, root / "out" / OPTIMISED)
    return sorted((root / "out").glob("*.html"))


def test_pages_load_nothing_else_and_report_no_error(browser, pages):
    assert len(pages) == 18
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


@pytest.mark.parametrize(("name", "styles"), [
    ("mill01_records", [("body", "backgroundColor"), (".plot .grid", "stroke"),
                        (".plot text", "fill"), (".plot .s-active", "fill")]),
    ("optimised", [(".plot .before", "stroke"), (".plot .after", "stroke"),
                   (".plot .s-before", "fill"), (".plot .s-after", "fill"), (".p-knee", "stroke")]),
])  # fmt: skip
def test_figures_follow_the_theme(browser, pages, name, styles):
    seen = {}
    for scheme in ("light", "dark"):
        look(browser, next(p for p in pages if p.stem == name), 1280, scheme)
        seen[scheme] = browser.execute_script(
            "return arguments[0].map(([s, p]) => getComputedStyle(document.querySelector(s))[p])",
            styles,
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


def test_words_below_a_figure_do_not_overlap_on_a_phone(browser, page):
    look(browser, page, 380, "light")
    overlaps = browser.execute_script(
        """
        let found = [];
        for (const plot of document.querySelectorAll('.plot')) {
          const boxes = [...plot.querySelectorAll('text')]
            .map(e => [e.textContent, e.getBoundingClientRect()]);
          for (let i = 0; i < boxes.length; i++) for (let j = 0; j < i; j++) {
            const [a, p] = boxes[i], [b, q] = boxes[j];
            if (p.left < q.right - 1 && q.left < p.right - 1 &&
                p.top < q.bottom - 4 && q.top < p.bottom - 4) found.push([a, b]);
          }
        }
        return found;
        """
    )
    assert overlaps == []


def test_the_slider_moves_the_mark_and_says_the_line(browser, page):
    look(browser, page, 1280, "light")
    seen = browser.execute_script(
        """
        const range = document.querySelector('.slider [type=range]');
        const state = () => [document.querySelector('.slider output').textContent,
          ...[...document.querySelectorAll('.mark')].map(
            m => m.getAttribute('cx') + ' ' + m.getAttribute('cy'))];
        const found = [state()];
        range.value = range.max;
        range.dispatchEvent(new Event('input'));
        found.push(state());
        const line = document.querySelector('.slider [type=number]');
        line.value = 100;
        line.dispatchEvent(new Event('input'));
        found.push(state());
        return found;
        """
    )
    said = [one[0] for one in seen]
    assert said[0].startswith("Line 5:") and said[1].startswith("Line 229:")
    assert said[2].startswith("Line 100:") and "F 200 → " in said[2]
    assert len({tuple(one[1:]) for one in seen}) == 3 and len(seen[0]) == 5  # two views, twice
    assert browser.get_log("browser") == []


def test_the_set_up_sheet_is_one_page_of_paper(browser, tmp_path):
    """A4 with the margins of the page: a sheet of 12 tools, 3 offsets and 12 warnings."""
    document = optimised(6, columns=60)
    sheet = document["setup"]
    sheet["tools"] = [{**sheet["tools"][0], "tool": k} for k in range(12)]
    sheet["offsets"] = sheet["offsets"] * 2
    sheet["warnings"] = sheet["warnings"] * 12
    out = tmp_path / "page.html"
    write_optimised_page(part(document), out)
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    width, height = round((210 - 30) / 25.4 * 96), (297 - 34) / 25.4 * 96
    look(browser, out, width, "light")
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    found = browser.execute_script(
        "const s = document.querySelector('#setup'), c = getComputedStyle(s);"
        "return [s.getBoundingClientRect().height, c.breakBefore, c.breakAfter,"
        " getComputedStyle(document.querySelector('.slider')).display]"
    )
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
    assert 200 < found[0] < height
    assert found[1:] == ["page", "page", "none"]
