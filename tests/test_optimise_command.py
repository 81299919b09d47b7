"""`kerf optimise`, as a process engineer uses it."""

import json
import os
import pty
import re
import shutil
import signal
import subprocess
import sys
import time
from hashlib import sha256
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.app.output import between
from pipeline.schema.store import write_json
from pipeline.submodels.following_residual import model as residual_model
from tests.report.page_reader import outline, words
from tests.small_project import ROOT
from tests.test_cli import kerf, refused
from tests.test_command_correction_command import drive_axis, judged, with_drives

PART = """%
O1000(SLOT)
N10 G21 G17 G90 G40
N20 T1 M6
N30 G0 G54 X-10. Y20. S3000 M3
N40 G43 Z5. H4
N50 G1 Z-1. F300.
N60 X30. F120.
N65 X70.
N66 Y25.
N67 X-10.
N70 G0 Z50.
N80 M30
%
"""
STOCK = "box:0,60,0,40,-10,0"
GIVEN = {
    "--machine": "mill01", "--stock": STOCK, "--tool-table": "sim2023", "--material": "A6061",
    "--resolution": "0.5", "--objective": "time", "--limit-load": "60",
}  # fmt: skip
OUT = ("--out", "better.nc", "--json", "better.json", "--page", "better.html")
WRITTEN = OUT[1::2]


def given(**changes: str | None) -> list[str]:
    """The options, some changed, those that are None left out."""
    options = GIVEN | {f"--{name.replace('_', '-')}": value for name, value in changes.items()}
    return [word for pair in options.items() if pair[1] is not None for word in pair]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with a program, and what the command makes of it."""
    folder = new(tmp_path_factory.mktemp("optimised"))
    done = kerf(folder, "optimise", "part.nc", *given(), "--feed", "50", "1000", "--speed", "1000",
                "8000", *OUT)  # fmt: skip
    assert done.exit_code == 0, done.output
    (folder / "said.txt").write_text(done.stdout)
    return folder


@pytest.fixture
def project(tmp_path: Path) -> Path:
    return new(tmp_path / "project")


def new(folder: Path) -> Path:
    """A project that searches as tests do."""
    shutil.copytree(ROOT / "conf", folder / "conf", symlinks=True)
    config = folder / "conf/config.yaml"
    config.write_text(config.read_text().replace("budget: default", "budget: quick"))
    (folder / "part.nc").write_text(PART)
    return folder


def test_following_errors_hold_the_network_where_it_is_asked_for(project, monkeypatch) -> None:
    """A limit holds against the error and half of its interval of 10 um."""
    limit = ("--limit-following", "60", "--feed", "50", "1000", "--speed", "3000", "3000")
    asked = ("optimise", "part.nc", *given(), *limit, *OUT)
    assert "drive/model.json does not exist" in refused(project, *asked, "--residual")
    folder = with_drives(project, "mill01", X=drive_axis(), Y=drive_axis(), Z=drive_axis())
    said = refused(project, *asked, "--residual")
    assert "mill01/following_residual holds no residual model that passed" in said

    def residual(letter, reference, modelled_error, modelled_command, period):
        return np.zeros(len(reference)), np.full(len(reference), 5e-6)

    loaded = SimpleNamespace(residual=residual)
    monkeypatch.setattr(residual_model, "load_residual", lambda found: loaded)
    write_json({}, folder / "following_residual/model.json")
    write_json(judged("following_residual", "passed"), folder / "following_residual/verdict.json")
    done = kerf(project, *asked, "--residual")
    assert done.exit_code == 0, done.output
    document = json.loads((project / "better.json").read_text())
    behind = max(document["verified"]["following_um"].values())
    assert behind <= 0.95 * 60 - 5 + 0.1  # without the network it goes up to the limit itself
    assert "following errors with residual network" in done.stdout
    assert document["residual"] in words(project / "better.html")


def test_only_f_and_s_differ_in_the_program_that_is_written(made: Path) -> None:
    done = kerf(made, "check", "part.nc", "better.nc", "--machine", "mill01")
    assert done.exit_code == 0, done.output
    assert (made / "better.nc").read_bytes() != (made / "part.nc").read_bytes()


def test_time_and_cost_are_those_that_simulate_tells_of_both_programs(made: Path) -> None:
    """Two ways to the same numbers: the document, and `kerf simulate` of the two files."""
    document = json.loads((made / "better.json").read_text())
    cut = [w for w in given(objective=None) if w != "--objective"]
    for which, name in (("before", "part.nc"), ("after", "better.nc")):
        done = kerf(made, "simulate", name, *cut, "--json", "s.json")
        assert done.exit_code == 0, done.output
        told = json.loads((made / "s.json").read_text())["cut"]["summary"]
        found = document[which]
        assert found["time_s"] == told["time_s"] and found["cost"] == told["cost"]["sum"]
        for key in ("energy_kWh", "tool_life_share", "peak_load_N"):
            assert found[key] == told[key]


def test_gains_groups_and_loads_of_the_document_agree_with_its_totals(made: Path) -> None:
    document = json.loads((made / "better.json").read_text())
    before, after = document["before"], document["after"]
    assert after["time_s"] < before["time_s"]  # chosen so that there is something to gain
    gain = 100 * (after["time_s"] / before["time_s"] - 1)
    assert document["gain"]["time_percent"] == pytest.approx(gain, abs=1e-3 * abs(gain))
    for which in ("before", "after"):
        groups = document["groups"]
        assert sum(g[f"time_{which}_s"] for g in groups) <= document[which]["time_s"] * (1 + 1e-6)
        peak = max(g[f"peak_load_{which}_N"] for g in groups)
        assert peak == pytest.approx(document[which]["peak_load_N"], rel=1e-5)  # six digits
        loads = [v for v in document["trace"][which]["load_N"] if v is not None]
        assert max(loads) == pytest.approx(peak, rel=1e-3)  # four digits
    assert after["beyond"] == 0 and after["peak_load_N"] <= 60
    assert document["certainty"]["exceedance"] <= document["certainty"]["interval_95"][1]
    fed = [g for g in document["groups"] if g["first_line"] <= 8 <= g["last_line"]]
    assert fed[0]["feed_before"] == 120.0 and fed[0]["speed_before"] == 3000.0
    assert fed[0]["tool"] == 1 and fed[0]["feed_unit"] == "mm/min"


def test_what_is_said_holds_gain_limits_and_proof(made: Path) -> None:
    said, document = (made / "said.txt").read_text(), json.loads((made / "better.json").read_text())
    for key, name in (("before_sha256", "part.nc"), ("after_sha256", "better.nc")):
        assert document["proof"][key] == sha256((made / name).read_bytes()).hexdigest()
    pairs = zip(PART.split(), (made / "better.nc").read_text().split(), strict=False)
    counts = document["words"]
    assert counts["F_added"] + counts["S_added"] > 0 or (
        sum(a != b for a, b in pairs) == sum(counts.values()) >= 1
    )
    assert "part.nc on mill01 (simulated)" in said
    assert re.search(r"before +after +change", said)
    for word in ("certainty: P(load > 60 N)", "its price", "direct",
                 "as programmed", "binds: ", "words: ", document["proof"]["sha256"],
                 "not known: deflection", "wrote better.nc, better.json, better.html"):  # fmt: skip
        assert word in said, word
    assert f"{document['gain']['time_percent']:+.1f} %" in said


def test_the_page_stands_on_the_json_and_loads_nothing(made: Path) -> None:
    text = words(made / "better.html")
    assert "better.json" in text and "simulated" in text.lower()
    scripts = [dict(given) for tag, given in outline(made / "better.html").tags if tag == "script"]
    assert all("src" not in given for given in scripts)


def test_the_same_seed_makes_the_same_bytes(made: Path) -> None:
    before = [(made / name).read_bytes() for name in WRITTEN]
    done = kerf(made, "optimise", "part.nc", *given(), "--feed", "50", "1000", "--speed", "1000",
                "8000", *OUT)  # fmt: skip
    assert done.exit_code == 0
    assert [(made / name).read_bytes() for name in WRITTEN] == before
    assert done.stderr == ""  # no bar where nobody looks


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (("--feed", "500", "100"), "--feed [500.0, 100.0] must be two numbers, the least first"),
        (("--chip", "5", "nan"), "--chip nan um must lie from 0"),
        (("--feed", "4000", "5000"), "an F that keeps the limits: widen them"),
        ({"stock": None}, "--stock is missing: give the blank"),
        ({"tool_table": None}, "--tool-table is missing: name a table"),
        ({"stock": "box:0,60,0,40,0,0"}, "nothing is cut: the blank box:0,60,0,40,0,0"),
        ({"stock": "box:500,560,0,40,-10,0"}, "the blank X 500..560"),
        ({"objective": "beauty"}, "'beauty' is not one of 'time', 'cost'"),
        ({"limit_load": "0.0001"}, "raise --limit-load"),
        ({"limit_deflection": "20"}, "--limit-deflection 20 cannot be kept: T1 has no stickout_mm"),
        ({"power_share": "0.5", "machine": "hurco"}, "--power-share 0.5 cannot be kept"),
        ({"power_share": "5"}, "--power-share 5.0 must lie above 0 and at most 2"),
        ({"resolution": "50"}, "a resolution of 50 mm is too coarse for T1, the widest tool with"),
        ({"least_speed_change": "-1"}, "--least-speed-change -1.0 rev/min"),
        ({"stability_margin": "1.5"}, "--stability-margin 1.5 must lie from 0 and below 1"),
        ({"epsilon": "0"}, "--epsilon 0.0 must lie from 0.0001 to"),
        ({"seed": "-1"}, "--seed -1 must lie from 0"),
        ({"speeds": "all"}, "'all' is not one of 'blocks', 'own'"),
    ],
)
def test_what_does_not_fit_is_one_sentence_and_nothing_is_written(
    project: Path, changes: dict | tuple[str, ...], said: str
) -> None:
    before = sorted(project.rglob("*"))
    options = given(**changes) if isinstance(changes, dict) else [*given(), *changes]
    assert said in refused(project, "optimise", "part.nc", *options, *OUT)
    assert sorted(project.rglob("*")) == before


TITLES = (
    "DRILL AND TAP M8", "REAM 10H7", "TASCHE SCHRUPPEN", "GEWINDE M6 SCHNEIDEN", "BOHREN, REIBEN",
    "Prüfteil ÄÖÜ", "FINISH FACE MILL", "PROBE", "TARAUDAGE M8", "FRESATURA E MASCHIATURA", "",
    "部品 100", "a" * 300, "T1 TAP M8", "T1 = REIBAHLE 10H7", "LINE 1-20", "100 %", "N10 G1 X0",
)  # fmt: skip
HELD = {
    "reamer": ("drill", "G85 Z-5. R2. F100.\nX40.\nG80"),
    "tap": ("drill", "G84 Z-5. R2. F500.\nX40.\nG80"),
    "boring_bar": ("flat", "G86 Z-5. R2. F50.\nG80"),
    "thread_mill": ("flat", "G1 Z-5. F200.\nG3 X20. Y20. Z-4. I3. J0. F100.\nG1 Z5."),
    "engraver": ("flat", "G1 Z-.1 F100.\nX30. F200.\nY30.\nG1 Z5."),
    "": ("flat", "G1 Z-1. F100.\nX40. F120.\nY30.\nG0 Z5."),
}
"""Moves in which nothing may change, by the role of their tool, which is kept where it has none."""
HOSTILE = (
    "", "--objective cost", "--objective energy", "--objective wear", "--objective pareto",
    "--limit-load 5", "--limit-load 1e5", "--feed 1 2", "--speed 1 2", "--chip 0.01 0.02",
    "--speeds own", "--epsilon 0.5 --limit-load 3000", "--power-share 0.001", "--change 1 1",
    "--stability-margin 0.9", "--limit-roughness 0.001", "--limit-deflection 1", "--seed 7",
    "--cutting-speed 1 2", "--tool-life 10000", "--air-feed 5000", "--feed-step 1000",
    "--speed-step 1000", "--limit-torque 0.001", "--limit-following 1", "--wear sharp",
    "--least-speed-change 100", "--keep Xyz", "--resolution 5",
)  # fmt: skip
INTERNAL = re.compile(r"search|bounds|shape|array|index|None|nan|\(0,\)|Traceback|<class")
"""Words of the inside, where one sentence says why there is no program."""
FAST = (1, 2, 40)
"""A boring bar, a tool that is kept, and a thread mill, which has no hostile option."""
SEEDS = [pytest.param(seed, marks=() if seed in FAST else pytest.mark.proof) for seed in range(100)]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_program_in_which_nothing_may_change_stays_and_says_why(project: Path, seed: int) -> None:
    """Or one sentence says which of the hostile options cannot be kept."""
    random = np.random.default_rng(seed)
    role = str(random.choice(list(HELD)))
    kind, moves = HELD[role]
    tool = f"{{kind: {kind}, role: '{role}', diameter_mm: 6.0, flutes: 2, price: 10}}"
    (project / "t.yaml").write_text(f"tools: {{1: {tool}}}")
    titles = [f"({title})" for title in random.choice(TITLES, 3)]
    text = "\n".join([
        "%", f"O1000{titles[0]}", titles[1], "G21 G17 G90 G40 G80", "T1 M6", titles[2] * (seed % 2),
        "G0 G54 X20. Y20. S500 M3", "G43 Z5. H1", moves, "G0 Z50.", "M30", "%", "",
    ])  # fmt: skip
    (project / "part.nc").write_bytes(text.encode(random.choice(["utf8", "latin1"]), "replace"))
    material = str(random.choice([file.stem for file in (ROOT / "conf/material").iterdir()]))
    options = given(tool_table="t.yaml", resolution="1", limit_load=None, material=material,
                    objective=None)  # fmt: skip
    hostile = str(random.choice(HOSTILE)).split()
    options += hostile + ["--keep", "T1"] * (role == "")
    done = kerf(project, "optimise", "part.nc", *options, *OUT)
    assert done.exit_code in ((0, 2) if hostile else (0,)), done.output
    if done.exit_code == 0:
        assert (project / "better.nc").read_bytes() == (project / "part.nc").read_bytes()
        (why,) = re.findall("  nothing to change: (.+)", done.stdout)
        assert re.search(r", \d+ blocks?", why)
        assert "Nothing to change" in words(project / "better.html")
    else:
        (said,) = done.stderr.splitlines()
        assert not INTERNAL.search(said) and not (project / "better.nc").exists()


MATERIALS = sorted(file.stem for file in (ROOT / "conf/material").glob("*.yaml"))
EVERY = [
    pytest.param(name, objective, edge, marks=() if name in some else pytest.mark.proof)
    for objective, edge, some in (
        ("cost", "carbide", ("steel_tool",)), ("wear", "carbide", ("titanium_alloy",)),
        ("cost", "hss", ("nickel_alloy",)),
    )
    for name in MATERIALS
]  # fmt: skip


@pytest.mark.parametrize(("name", "objective", "edge"), EVERY)
def test_cost_and_wear_are_known_in_every_material_or_say_what_is_missing(
    project: Path, name: str, objective: str, edge: str
) -> None:
    tool = f"kind: flat, diameter_mm: 6.0, flutes: 2, price: 20000, material: {edge}"
    (project / "t.yaml").write_text(f"tools: {{1: {{{tool}}}}}")
    (project / "part.nc").write_text(PART.replace("S3000", "S1000").replace("Z-1.", "Z-.5"))
    options = given(tool_table="t.yaml", limit_load=None, material=name, objective=objective)
    done = kerf(project, "optimise", "part.nc", *options, *OUT)
    if edge == "hss" and name in ("nickel_alloy", "titanium_alloy"):
        (said,) = done.stderr.splitlines()
        assert done.exit_code == 2 and "no source of the life of high-speed steel" in said
        return
    assert done.exit_code == 0, done.output
    document = json.loads((project / "better.json").read_text())
    spread = name != "brass" or edge == "carbide"
    for which in ("before", "after"):
        for key in ("cost", "tool_life_share"):
            low, value, high = (document[which].get(f"{key}{end}") for end in ("_low", "", "_high"))
            assert value is not None and (low is not None) == spread
            assert not spread or low <= value <= high
    assert any(note.startswith("tool life of T1: v_c ") for note in document["notes"])
    unsure = [one["what"] for one in document["not_known"]]
    assert ("interval of the tool life of T1" in unsure) != spread
    if spread:
        low, high = (document["after"][f"tool_life_share_{end}"] for end in ("low", "high"))
        assert between(low, high, 100) in done.stdout
        assert " to " in words(project / "better.html")


def test_without_a_file_for_the_program_it_says_so(project: Path) -> None:
    said = refused(project, "optimise", "part.nc", *given(), "--json", "better.json")
    assert "--out is missing: name a file for the optimised program" in said
    assert not (project / "better.json").exists()


def test_a_program_is_never_written_over(project: Path) -> None:
    said = refused(project, "optimise", "part.nc", *given(), "--out", "part.nc")
    assert "part.nc is the program itself" in said
    assert (project / "part.nc").read_text() == PART


def command(project: Path) -> list[str]:
    return [sys.executable, "-m", "pipeline.app", "optimise", "part.nc", *given(), "--feed", "50",
            "1000", *OUT]  # fmt: skip


def watched(project: Path, share: float | None) -> tuple[int, bytes]:
    """Exit status, and what a person sees who presses Ctrl-C at the first bar of ``share`` %."""
    ours, theirs = pty.openpty()
    done = subprocess.Popen(
        command(project), cwd=project, stdout=subprocess.DEVNULL, stderr=theirs,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "100"}, start_new_session=True,
    )  # fmt: skip
    os.close(theirs)
    seen, sent, begin = b"", share is None, time.monotonic()
    while time.monotonic() - begin < 300:
        try:
            part = os.read(ours, 4096)
        except OSError:  # the other end is closed
            break
        seen += part
        if not sent and f"{share:.0f}%".encode() in seen:
            done.send_signal(signal.SIGINT)
            sent = True
    os.close(ours)
    return done.wait(timeout=300), seen


@pytest.mark.slow
def test_ctrl_c_leaves_the_best_so_far(project: Path) -> None:
    config = project / "conf/optimisation/default.yaml"
    config.write_text(config.read_text().replace("generations: 40", "generations: 100000"))
    budget = project / "conf/budget/quick.yaml"
    budget.write_text(budget.read_text().replace("generations: 10", "generations: 100000"))
    status, seen = watched(project, 30)
    assert status == 130
    assert b"ending with the best so far" in seen and b"searching" in seen
    assert json.loads((project / "better.json").read_text())["interrupted"] is True
    assert "interrupted" in words(project / "better.html")
    done = kerf(project, "check", "part.nc", "better.nc", "--machine", "mill01")
    assert done.exit_code == 0


@pytest.mark.slow
def test_ctrl_c_before_there_is_anything_writes_nothing(project: Path) -> None:
    before = sorted(p for p in project.rglob("*") if p.suffix != ".pyc")
    status, seen = watched(project, 0)
    assert status == 130 and b"nothing is written" in seen
    assert sorted(p for p in project.rglob("*") if p.suffix != ".pyc") == before
