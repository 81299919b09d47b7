import csv
import json
import re
import shutil
from dataclasses import replace
from html import unescape
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest
from page_reader import every_word, evidence, outline, section
from report_folders import FLEET, empty_machine, machine, reported, write_signals, write_table

from pipeline.report.changes import KeyFigures
from pipeline.report.folders import FleetInfo, MachineFolders
from pipeline.report.pages import ReportMetrics, SubModelCounts, write_report
from pipeline.schema.bundle import Bundle, BundledModel, model_hash
from pipeline.schema.store import read_json, write_json
from pipeline.schema.verdict import Status, Verdict


@pytest.fixture(scope="module")
def report(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("report")
    fleet = [
        machine(root, "mill01", description="15 kW mill-turn"),
        machine(root, "lathe", "recorded", passed=False, credit="Records: Test Works, CC0",
                missing=(("forces", "10 min with a dynamometer"),)),
        empty_machine(root, "new_mill", "recorded", submodels=("spindle",)),
    ]  # fmt: skip
    write_report(fleet, FLEET, None, root / "out")
    return root / "out"


def test_every_page_of_a_simulated_machine_is_labelled_once_in_its_head(report):
    pages = [report / "mill01.html", *evidence(report / "mill01.html")]
    assert len(pages) == 3
    for page in pages:
        text = page.read_text()
        assert text.count('class="label simulated"') == 1
        assert 'class="label simulated"' in text.split("<h1>")[0]
        assert "(simulated)" in text.partition("</title>")[0]


def test_every_page_says_at_its_head_that_it_was_built_quickly(tmp_path):
    folders = [machine(tmp_path, "mill01")]
    for budget in ("quick", "default"):
        info = FleetInfo(name="Hall 3", budget=budget)
        for page in write_report(folders, info, None, tmp_path / budget):
            head = page.read_text(encoding="utf-8").partition("</header>")[0]
            assert ("Quick budget: " in head) == (budget == "quick"), page.name


def test_recorded_results_carry_their_credit_and_no_simulated_label(report):
    pages = [report / "lathe.html", *evidence(report / "lathe.html")]
    text = "".join(page.read_text() for page in pages)
    assert "label simulated" not in text
    sources = re.findall(r'<p class="source">(Source.*?)</p>', text, flags=re.S)
    assert len(sources) > 5
    assert all("Records: Test Works, CC0" in s for s in sources)
    for key in ("work", "spindle-judged", "time"):
        assert len(re.findall(r'<p class="source">', section(pages[0], key))) == 1


def test_units_of_a_judge_are_set_as_they_are_read(tmp_path):
    folders = machine(tmp_path, "mill01", passed=False)
    path = folders.models / "spindle" / "verdict.json"
    reason = "growth, largest error 9 um is above 6 um, 1.5e-05 N/mm^2 and -3 deg"
    write_json(replace(read_json(path, Verdict), reasons=(reason,)), path)
    write_report([folders], FLEET, None, tmp_path / "out")
    words = " ".join(page.read_text() for page in evidence(tmp_path / "out" / "mill01.html"))
    assert "error 9\u202fµm is above 6\u202fµm, 1.5 × 10⁻⁵ N/mm² and −3°" in words
    tables = re.findall(r'href="(data:text/csv[^"]*)"', words)
    assert len(tables) > 3 and all(one.isascii() for one in tables)  # to be read by programs


def test_every_figure_says_in_words_what_it_shows(report):
    pages = [report / "mill01_records.html", report / "mill01_spindle.html"]
    figures = [a for p in pages for _, a in outline(p).tags if a.get("role") == "img"]
    assert len(figures) == 5
    assert all(len(a["aria-label"]) > 40 for a in figures)
    assert any("Worst day" in a["aria-label"] and "MAE 0.900" in a["aria-label"] for a in figures)


def test_every_head_has_a_scope_and_every_page_its_landmarks(report):
    for page in ("index.html", "mill01.html"):
        tags = outline(report / page).tags
        assert all("scope" in a for t, a in tags if t == "th")
        assert {"header", "main", "footer"} <= {t for t, _ in tags}
        assert next(a for t, a in tags if t == "html")["lang"] == "en"


def test_nothing_is_loaded_and_no_script_runs(report):
    for page in report.glob("*.html"):
        tags = outline(page).tags
        assert not [t for t, _ in tags if t in ("script", "img", "iframe", "object", "base")]
        links = [a.get("href", "") for t, a in tags if t in ("a", "link")]
        assert all(
            h.startswith(("#", "data:")) or re.fullmatch(r"\w+\.html(#[\w-]+)?", h) for h in links
        )
        assert "url(" not in page.read_text() and "@import" not in page.read_text()
        assert "default-src 'none'" in page.read_text()


def test_a_failed_model_says_so_and_what_to_do(report):
    text = every_word(report / "lathe.html")
    assert "Twin: spindle temperature failed" in text
    assert "failed on 2 days of its golden set" in text
    said = r"error over one hour \(MAE\) up to \S+ K in .{3,20} \(limit 2\.00 K\)"
    assert re.search(said, text.replace("\xa0", " "))
    assert "Do not act on this model’s temperatures" in text
    assert "MAE over one hour is above 2.0 K" in text


def test_what_is_missing_stands_with_what_to_record(report):
    text = every_word(report / "lathe.html")
    assert "forces" in text and "10 min with a dynamometer" in text


def test_a_machine_without_any_file_has_a_page_that_says_so(report):
    text = every_word(report / "new_mill.html")
    assert "Twin: not judged yet" in text
    assert "Nothing has been read of this machine yet" in text
    for part in ("manifest.json", "spindle/model.json"):
        assert re.search(rf"Not known: there is no \S*{part}", text)


FILES = (
    "signals/m/rejected.parquet", "clean/m/state", "clean/m/cycles.parquet",
    "clean/m/segments.parquet", "clean/m/audit.parquet", "clean/m/gaps.parquet",
    "clean/m/alarms.parquet",
    "models/m/spindle/model.json", "models/m/spindle/verdict.json",
    "models/m/spindle/predictions.parquet",
    "golden/m.json", "truth/m.json", "signals/m/manifest.json",
)  # fmt: skip


@pytest.fixture(scope="module")
def complete(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("complete")
    machine(root, "m", days=3)
    return root


def reread(root: Path) -> MachineFolders:
    """The machine ``m`` of which some files were changed."""
    return empty_machine(root, "m", truth=root / "truth" / "m.json", submodels=("spindle",))


FEW = ("clean/m/state", "models/m/spindle/verdict.json", "signals/m/rejected.parquet")
"""A folder, a document and a table: of each kind one is tried whenever the tests are run."""
EACH_FILE = [one if one in FEW else pytest.param(one, marks=pytest.mark.proof) for one in FILES]


@pytest.mark.parametrize("lost", EACH_FILE)
def test_any_single_missing_file_is_named_or_leaves_the_rest_whole(complete, tmp_path, lost):
    shutil.copytree(complete, tmp_path / "root")
    path = tmp_path / "root" / lost
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    folders = reread(tmp_path / "root")
    text = reported(tmp_path, folders)
    rest = "Time ACTIVE" if "state" in lost else "3 days with records"
    assert rest in text
    assert f"made from {path.name}" not in text


@pytest.mark.parametrize("broken", [f for f in EACH_FILE if f != "clean/m/state"])
def test_a_broken_file_is_named_with_the_reason(complete, tmp_path, broken):
    shutil.copytree(complete, tmp_path / "root")
    (tmp_path / "root" / broken).write_bytes(b"\x00not what it says")
    folders = reread(tmp_path / "root")
    text = reported(tmp_path, folders)
    assert re.search(
        rf"{re.escape(Path(broken).name)} was left out: (not|is no) (JSON|Parquet)", text
    )


ODD = {
    "parameters": {"a": 1},
    "windows": {"days": [7, {}]},
    "verdict": "passed",
    "week": {"from": 3},
    "fit": [],
    "reasons": "one",
    "found_from": {},
    "files": {"x": 4},
}


@pytest.mark.parametrize("content", ["{}", "[]", '{"parameters": [], "week": 3}', json.dumps(ODD)])
def test_documents_of_another_shape_never_stop_the_report(complete, tmp_path, content):
    shutil.copytree(complete, tmp_path / "root")
    for name in FILES:
        if name.endswith(".json"):
            (tmp_path / "root" / name).write_text(content)
    folders = reread(tmp_path / "root")
    assert "What the machine did" in reported(tmp_path, folders)


HOSTILE = "<script>alert('x')</script>\"><img src=x onerror=alert(1)>"


def test_text_from_records_stays_text(tmp_path):
    folders = machine(tmp_path, "mill01", program=HOSTILE, state=HOSTILE, description=HOSTILE,
                      credit=HOSTILE, missing=((HOSTILE, HOSTILE),))  # fmt: skip
    write_table(folders.signals / "rejected.parquet", {
        "file": [HOSTILE], "line": [1], "reason": [HOSTILE], "excerpt": [HOSTILE],
    })  # fmt: skip
    write_report([folders], FleetInfo(name=HOSTILE, notes=(HOSTILE,)), None, tmp_path / "out")
    for page in (tmp_path / "out").glob("*.html"):
        tags = [t for t, _ in outline(page).tags]
        assert "script" not in tags and "img" not in tags
        assert "alert(1)" in every_word(page)


def test_a_name_that_is_no_file_name_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"'\.\./x' cannot name a page"):
        empty_machine(tmp_path, "../x")


def test_two_machines_of_one_name_are_refused(tmp_path):
    twice = [empty_machine(tmp_path, "m"), empty_machine(tmp_path, "m")]
    with pytest.raises(ValueError, match="m stands twice"):
        write_report(twice, FLEET, None, tmp_path / "out")


def test_key_figures_agree_with_the_files_they_come_from(report):
    stored = read_json(report / "report.json", KeyFigures)
    machine = stored.machines["mill01"]
    assert stored.format == 2
    assert {name: machine.figures[name].value for name in ("records", "rejected", "cycles")} == {
        "records": 4 * 60_000, "rejected": 4 * 3, "cycles": 12
    }  # fmt: skip
    assert machine.figures["days"].value == 4
    assert machine.figures["window_mae_K"].value == 0.8
    assert machine.parameters["spindle"][""]["windage"].value is None


def test_a_figure_stays_small(report):
    text = "".join(page.read_text() for page in evidence(report / "mill01.html"))
    figures = re.findall(r"<figure id=.*?</figure>", text, flags=re.S)
    assert len(figures) == 5
    assert max(len(f) for f in figures) < 60_000  # bytes of SVG, so that a page loads on a phone


def test_reasons_that_differ_in_what_they_quote_are_one(report):
    assert "‘…’ is no time" in every_word(report / "mill01.html")
    assert "2024-03-05T24:61' is" not in every_word(report / "mill01.html")


def test_what_stands_in_no_manifest_entry_is_not_known_not_zero(tmp_path):
    folders = empty_machine(tmp_path, "m")
    write_signals(folders, ["2024-03-04"])
    path = folders.signals / "manifest.json"
    path.write_text('{"files": {"a.txt": {"reason": "it is a picture", "rows": 0}}}')
    text = reported(tmp_path, folders)
    assert "1 file could not be read at all: a.txt" in text
    assert "a.txt – not known not known not known" in text


def luminance(colour: str) -> float:
    parts = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])  # WCAG 2.2, relative luminance


def contrast(a: str, b: str) -> float:
    low, high = sorted((luminance(a), luminance(b)))
    return (high + 0.05) / (low + 0.05)


TEXT = ("ink", "soft", "accent", "free", "good", "bad", "warn")
GRAPHICS = (
    "active", "ready", "hold", "interrupted", "stopped", "other", "held", "lost", "f0", "f1", "f2",
    "f3",
)  # fmt: skip


def test_text_and_graphics_stand_out_from_the_page_in_both_themes(report):
    """WCAG 2.2, AA: 4.5:1 for text; 1.4.11: 3:1 for graphics that carry meaning."""
    light, dark = re.findall(r":root \{(.*?)\}", (report / "index.html").read_text(), flags=re.S)
    wanted = [(name, ground, 4.5) for name in TEXT for ground in ("paper", "wash")]
    for theme in (light, dark):
        colours = dict(re.findall(r"--(\w+): (#[0-9a-f]{6})", theme))
        for name, ground, least in (*wanted, *((name, "paper", 3) for name in GRAPHICS)):
            ratio = contrast(colours[name], colours[ground])
            assert ratio >= least, f"{name} on {ground}: {ratio:.2f}"


def test_a_table_is_saved_as_csv_without_a_script(report):
    text = (report / "mill01.html").read_text()
    links = re.findall(r'<a href="data:text/csv;charset=utf-8,([^"]*)" download="([^"]+)"', text)
    saved = {name: list(csv.reader(unquote(unescape(data)).splitlines())) for data, name in links}
    rows = saved["mill01-time-t1.csv"]
    assert rows[0] == ["Time", "week 10, h"], "one week has no other to compare with"
    assert rows[1][0] == "Active" and len(rows[1]) == 2


def test_links_to_figures_and_tables_lead_somewhere(report):
    for page in report.glob("*.html"):
        tags = outline(page).tags
        ids = [a["id"] for _, a in tags if "id" in a]
        assert len(ids) == len(set(ids))
        for href in (a["href"] for t, a in tags if t == "a" and not a["href"].startswith("data:")):
            file, _, anchor = href.partition("#")
            there = report / file if file else page
            assert there.is_file(), href
            assert not anchor or f'id="{anchor}"' in there.read_text(), href


def test_metrics_count_machines_and_submodels_with_the_same_keys_for_each(tmp_path):
    fleet = [machine(tmp_path, "a"), machine(tmp_path, "b", passed=False),
             empty_machine(tmp_path, "c", submodels=("spindle", "control"))]  # fmt: skip
    write_report(fleet, FLEET, None, tmp_path / "out", tmp_path / "metrics.json")
    metrics = read_json(tmp_path / "metrics.json", ReportMetrics)
    assert metrics.status == {"failed": 1, "attention": 0, "passed": 1, "unknown": 1}
    assert metrics.machines["a"].submodels == SubModelCounts(passed=1, failed=0, not_judged=0)
    assert metrics.machines["b"].status == "failed" and metrics.machines["b"].records == 240_000
    assert metrics.machines["c"].submodels == SubModelCounts(passed=0, failed=0, not_judged=2)


def champion(folders: MachineFolders, status: Status) -> str:
    """Let the model that is on disk serve, with a verdict of its own; the beginning of its hash."""
    sha256 = model_hash(folders.models / "spindle")
    serves = {"spindle": BundledModel(sha256=sha256, status=status)}
    bundle = Bundle(machine=folders.name, origin="simulated", submodels=serves, sha256="b0" * 32)
    write_json(bundle, folders.champion / "bundle.json")
    return sha256[:12]


def test_the_champion_is_shown_and_is_no_news_while_it_is_the_latest(tmp_path):
    folders = machine(tmp_path, "m")
    sha256 = champion(folders, "passed")
    text = reported(tmp_path, folders)
    assert f"spindle temperature {sha256} passed the same" in text
    assert "champion that serves has another model" not in text


def test_a_champion_that_is_older_or_failed_stands_in_the_head(tmp_path):
    folders = machine(tmp_path, "m")
    champion(folders, "failed")
    machine(tmp_path, "m", days=5)  # a new fit
    write_report([folders], FLEET, None, tmp_path / "out")
    head = every_word(tmp_path / "out" / "m.html")
    assert "What serves has another model of spindle temperature" in head
    assert "Of the champion that serves, the model of spindle temperature failed" in head
