"""The pages in a real browser: no error, no request beyond the file, no sideways scrolling."""

import json
from pathlib import Path

import pytest
from report_folders import FLEET, empty_machine, machine

from pipeline.report.pages import write_report

CHROMIUM, DRIVER = Path("/usr/bin/chromium"), Path("/usr/bin/chromedriver")
pytestmark = pytest.mark.skipif(
    not (CHROMIUM.exists() and DRIVER.exists()),
    reason="no /usr/bin/chromium with /usr/bin/chromedriver: apt install chromium-driver",
)
FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking",
         "--disable-component-update", "--disable-sync", "--no-first-run")  # fmt: skip
HOSTILE = "<script>document.title='owned'</script>" + "W" * 120


@pytest.fixture(scope="module")
def pages(tmp_path_factory) -> list[Path]:
    root = tmp_path_factory.mktemp("browser")
    fleet = [
        machine(root, "mill01", days=3),
        machine(root, "hostile", program=HOSTILE, state=HOSTILE, description=HOSTILE, days=3),
        machine(root, "lathe", "recorded", days=3, passed=False, credit="Records: Test Works"),
        empty_machine(root, "new_mill", "recorded", missing=((HOSTILE, HOSTILE),)),
    ]
    write_report(fleet, FLEET, None, root / "out")
    return sorted((root / "out").glob("*.html"))


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = str(CHROMIUM)
    for flag in (*FLAGS, f"--user-data-dir={tmp_path_factory.mktemp('profile')}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(str(DRIVER)))
    yield driver
    driver.quit()


def look(browser, page: Path, width: int, scheme: str) -> None:
    feature = {"name": "prefers-color-scheme", "value": scheme}
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [feature]})
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": 800, "deviceScaleFactor": 1, "mobile": width < 600},
    )
    browser.get(page.as_uri())
    for details in browser.find_elements("tag name", "details"):
        browser.execute_script("arguments[0].open = true", details)


def requests(browser) -> list[str]:
    events = [json.loads(e["message"])["message"] for e in browser.get_log("performance")]
    sent = [e["params"] for e in events if e["method"] == "Network.requestWillBeSent"]
    # The browser's own first tab, not a page of the report, asks for chrome:// addresses.
    return [p["request"]["url"] for p in sent if not p["documentURL"].startswith("chrome://")]


def test_pages_load_nothing_else_and_report_no_error(browser, pages):
    assert len(pages) == 5
    for page in pages:
        look(browser, page, 1280, "light")
        urls = requests(browser)
        assert page.as_uri() in urls  # the log does see requests
        assert [u for u in urls if not u.startswith(("file://", "data:"))] == []
        assert browser.get_log("browser") == []
        assert browser.title != "owned"


@pytest.mark.parametrize("width", [380, 768, 1280])
def test_no_page_scrolls_sideways_with_everything_unfolded(browser, pages, width):
    for page in pages:
        look(browser, page, width, "light")
        beyond = browser.execute_script(
            "return document.documentElement.scrollWidth - document.documentElement.clientWidth"
        )
        assert beyond <= 0, f"{page.name} is {beyond} px too wide at {width} px"


def test_figures_follow_the_theme(browser, pages):
    page = next(p for p in pages if p.stem == "mill01")
    seen = {}
    for scheme in ("light", "dark"):
        look(browser, page, 1280, scheme)
        seen[scheme] = browser.execute_script(
            "const c = (s, p) => getComputedStyle(document.querySelector(s))[p];"
            "return [c('body', 'backgroundColor'), c('.plot .measured', 'stroke'),"
            " c('.plot text', 'fill'), c('.plot .s-active', 'fill')]"
        )
    assert all(a != b for a, b in zip(seen["light"], seen["dark"], strict=True))


def test_words_in_figures_keep_their_size_on_a_phone(browser, pages):
    page = next(p for p in pages if p.stem == "mill01")
    look(browser, page, 380, "light")
    heights = browser.execute_script(
        "return [...document.querySelectorAll('.plot text')]"
        ".map(e => e.getBoundingClientRect().height)"
    )
    assert len(heights) > 20
    assert min(heights) >= 11  # px; a line of 12 px type
