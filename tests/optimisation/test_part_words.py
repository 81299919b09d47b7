"""What an optimised program says to who runs it: an inch program with a tool that misses."""

import json
from pathlib import Path

import pytest

from tests.optimisation.machinist import Order, cut_of, new_project
from tests.report.page_reader import words
from tests.test_cli import kerf

ORDER = Order(
    name="inch", machine="mill01", stock="box:0,50.8,0,38.1,-12.7,0", material="steel_tool",
    limit_load=4000.0, resolution=0.5,
)  # fmt: skip
NO_RADIUS = "G41 of T2 takes D2, which is 0 or not given"


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = new_project(tmp_path_factory.mktemp("inch") / "project", ORDER)
    steel = folder / "conf/material/steel_tool.yaml"
    steel.write_text(steel.read_text().partition("taylor:")[0])  # its tool lives are not known
    done = kerf(folder, "optimise", "inch.nc", *cut_of(ORDER), "--out", "o.nc", "--json", "o.json",
                "--page", "o.html")  # fmt: skip
    assert done.exit_code == 0, done.stderr
    (folder / "said.txt").write_text(done.stdout)
    return folder


@pytest.fixture
def document(project: Path) -> dict:
    return json.loads((project / "o.json").read_text())


def test_feeds_are_those_of_the_text(project: Path, document: dict) -> None:
    assert document["unit"] == "inch"
    (change,) = [one for one in document["changes"] if one["operation"] == "slotting"]
    assert (change["feed_unit"], change["feed_before"]) == ("in/min", 6.0)
    line = (project / "o.nc").read_text().splitlines()[change["first_line"] - 1]
    assert line.endswith(f"F{change['feed_after']:g}") or f"F{change['feed_after']:g}." in line
    f_z = change["feed_after"] * 25.4 / (3 * change["speed_after"])
    assert change["feed_per_tooth_after_mm"] == pytest.approx(f_z, rel=1e-5)
    text = words(project / "o.html").replace("\u202f", " ")
    assert "F is in inch, as the program writes it (G20)" in text
    assert f"6 → {change['feed_after']:g}" in text


def test_the_rise_of_a_tool_names_its_line(document: dict) -> None:
    rise = document["tools"][0]["rise"]
    assert rise["line"] == 13 and rise["after_mm"] > rise["before_mm"]
    assert rise["before_mm"] == pytest.approx(6 * 25.4 / (3 * 2000), rel=1e-5)


def test_what_is_kept_says_why_and_binds_nothing(document: dict) -> None:
    (reamer,) = [one for one in document["tools"] if one["tool"] == 3]
    assert reamer["kept"] == "reaming keeps F and S" and reamer["binds"] is None
    group = next(one for one in document["groups"] if one["tool"] == 3)
    assert (group["kept"], group["binds"]) == ("reaming keeps F and S", None)
    (binding,) = [one for one in document["binding"] if one["kept"]]
    assert (binding["limit"], binding["kept"]) == ("kept as programmed", "reaming keeps F and S")


def test_why_s_is_not_raised_stands_beside_the_tool(project: Path, document: dict) -> None:
    mill = document["tools"][0]
    assert mill["after"]["cutting_speed_m_min"] == mill["before"]["cutting_speed_m_min"]
    assert mill["no_faster"] == (
        "tool life of carbide in this material is not known; "
        "its stability is not known and no range of S is given"
    )
    assert "S not raised: T1" in (project / "said.txt").read_text()
    shown = words(project / "o.html")
    assert "S not raised" in shown and mill["no_faster"] in shown


def test_warnings_stand_first(project: Path, document: dict) -> None:
    assert next(iter(document)) == "warnings"
    said = [one["what"] for one in document["warnings"]]
    assert any(one.startswith(NO_RADIUS) for one in said)
    assert "T2 is fed and cuts nothing" in said
    (nothing,) = [one for one in document["warnings"] if "cuts nothing" in one["what"]]
    assert set(nothing["lines"]) <= {19, 20, 21, 22}
    printed = (project / "said.txt").read_text().splitlines()
    head = next(k for k, line in enumerate(printed) if line.startswith("inch.nc on mill01"))
    assert all(line.startswith("not listed in conf/machine") for line in printed[:head])
    assert [line.startswith("  warning: ") for line in printed[head + 1 : head + 3]] == [True, True]
    text = words(project / "o.html")
    assert text.index("cuts nothing") < text.index("Largest increases")
    assert "Enter 8 mm as the diameter of D2 in the machine’s file" in text


def test_simulate_warns_of_the_same(project: Path, document: dict) -> None:
    done = kerf(project, "simulate", "inch.nc", *cut_of(ORDER))
    assert done.exit_code == 0
    for one in document["warnings"]:
        assert f"  warning: {one['what']}" in done.stdout
    conf = project / "conf/machine/mill01.yaml"
    whole = conf.read_text()
    try:
        conf.write_text(whole.replace("2: {length: 109.977}", "2: {length: 109.977, diameter: 8}"))
        done = kerf(project, "simulate", "inch.nc", *cut_of(ORDER))
    finally:
        conf.write_text(whole)
    assert done.exit_code == 0 and NO_RADIUS not in done.stdout
