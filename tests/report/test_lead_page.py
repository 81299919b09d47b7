"""The lead's page at its fullest: three screens of 1280 by 800, two sheets of A4, each language."""

import re
from base64 import b64decode
from dataclasses import replace
from pathlib import Path

import pytest
from report_folders import FLEET, machine

from pipeline.charts.sections import Action
from pipeline.report.changes import Change
from pipeline.report.facts import ActionRow, machine_facts
from pipeline.report.lead_page import MOST_ACTIONS, lead_page
from pipeline.report.provenance import UNKNOWN
from pipeline.report.scorecard import Counts, Line
from pipeline.report.standalone_page import renderer
from pipeline.report.texts import languages, texts
from pipeline.report.verdict import machine_verdict
from tests.browser import look, needs_browser

pytestmark = needs_browser
SCREENS, SHEETS = 3, 2
ROW = ActionRow(
    action=Action(
        what="Do not plan cuts with these forces; record the failed conditions with a new edge",
        where="Twin: following error", until="before it is used", who="process engineer",
        why="Magnitude of the force in the plane, mean error, in up-n3600f500: 12.5 %, limit 10 %.",
    ),
    href="m_cutting.html",
)  # fmt: skip
LINE = Line(
    use="correct contours", status="failed", word="no", judged_on="on records held out",
    href="m_cutting.html", typical="4.31 µm (14 290 values; bias −0.51 µm)",
    serves="another than this: version 3 since Mon 5 Jan",
    figure=Counts(
        what="magnitude of the force in the plane, mean error, in up-n3600f500ap1",
        value="12.5 %", limit="10 %", baseline="1.63 % by recorded override only", interval="94 %",
        worse="bias −12.7 N; elsewhere up to 17.3 %",
    ),
)  # fmt: skip
CHANGE = Change(what="Following error, RMS of the worst axis", before="1.25 µm", now="1.26 µm",
                difference="+0.01 µm")  # fmt: skip


@pytest.fixture(params=languages())
def page(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A page with as many actions as it shows at once, eight sub-models and ten changes."""
    say = texts(request.param)
    facts = machine_facts(machine(tmp_path, "m", days=8))
    rows = [replace(ROW, since=f"2024-03-{day:02d}", risk=2, course=(1.0, 3.0, 2.0))
            for day in range(1, MOST_ACTIONS + 4)]  # fmt: skip
    verdict = replace(machine_verdict(facts, say), actions=rows)
    whole = lead_page(facts, verdict, [], [CHANGE] * 10, "", since="the last report", say=say)
    found = tmp_path / "m.html"
    full = replace(whole, scorecard=[LINE] * 8, pages=[("m_cutting.html", "Cutting force")] * 9)
    found.write_text(
        renderer(say)("machine.html.j2", found.name, UNKNOWN, page=full, fleet=FLEET).html
    )
    return found


def test_a_full_page_takes_three_screens_and_two_sheets(browser, page: Path) -> None:
    look(browser, page, 1280, "light")
    for details in browser.find_elements("tag name", "details"):
        browser.execute_script("arguments[0].open = false", details)
    height = browser.execute_script("return document.documentElement.scrollHeight")
    assert height <= SCREENS * 800
    printed = browser.execute_cdp_cmd(
        "Page.printToPDF", {"preferCSSPageSize": True, "printBackground": False}
    )
    assert len(re.findall(rb"/Type\s*/Page\b(?!s)", b64decode(printed["data"]))) <= SHEETS
