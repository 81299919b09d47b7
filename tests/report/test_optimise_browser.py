"""The page of an optimised program in a real browser."""

from pathlib import Path

import pytest
from optimise_documents import optimised, part

from pipeline.report.optimised_page import write_optimised_page
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


@pytest.mark.parametrize("width", [380, 768, 1280])
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
