"""The page of an optimised program in a real browser."""

from pathlib import Path

import pytest
from optimise_documents import optimised, part

from pipeline.report.optimised.page import write_optimised_page
from tests.browser import foreign, look, needs_browser, requests

pytestmark = needs_browser
HOSTILE = "<script>document.title='owned'</script>" + "W" * 120


@pytest.fixture(scope="module")
def page(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("optimised") / "page.html"
    write_optimised_page(part(optimised(300, columns=900, name=HOSTILE)), out)
    return out


def test_it_loads_nothing_else_and_reports_no_error(browser, page):
    look(browser, page, 1280, "light")
    urls = requests(browser)
    assert page.as_uri() in urls and foreign(urls) == []
    assert browser.get_log("browser") == [] and browser.title != "owned"


@pytest.mark.parametrize("width", [380, pytest.param(768, marks=pytest.mark.proof), 1280])
def test_it_does_not_scroll_sideways(browser, page, width):
    look(browser, page, width, "light")
    beyond = browser.execute_script(
        "return document.documentElement.scrollWidth - document.documentElement.clientWidth"
    )
    assert beyond <= 0


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


def test_figures_follow_the_theme(browser, page):
    seen = {}
    for scheme in ("light", "dark"):
        look(browser, page, 1280, scheme)
        seen[scheme] = browser.execute_script(
            "const c = (s, p) => getComputedStyle(document.querySelector(s))[p];"
            "return [c('.plot .before', 'stroke'), c('.plot .after', 'stroke'),"
            " c('.plot .s-before', 'fill'), c('.plot .s-after', 'fill'), c('.p-knee', 'stroke')]"
        )
    assert all(a != b for a, b in zip(seen["light"], seen["dark"], strict=True))


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
