"""`kerf simulate` and `kerf optimise` with worn tools, from a stored model of wear."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.schema.model import Parameter
from pipeline.schema.store import write_json
from pipeline.schema.verdict import Fact, JudgedCase
from pipeline.submodels.wear import due
from pipeline.submodels.wear.due import EDGE_NAMES, UNIT, EdgeGrowth, Lasting
from pipeline.submodels.wear.life import fit_life, uses
from tests.report.page_reader import words
from tests.submodels.wear.shop_lives import life_settings, tools, windows
from tests.submodels.wear.worn_tools import Built, build
from tests.test_cli import kerf, refused
from tests.test_cutting_commands import CUT, project  # noqa: F401
from tests.test_optimise_command import OUT, given, new

K = {EDGE_NAMES[0]: (125.0, 40.0), EDGE_NAMES[1]: (430.0, 80.0)}
"""Growth and half of its interval [N/mm^2]."""


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Built:
    return build(tmp_path_factory.mktemp("wear"))


def with_wear(folder: Path, built: Built, material: str = "A6061") -> None:
    """A champion whose model of wear has a growth of forces; T4 is in use, read at 90 um."""
    settings = life_settings("mill01")
    life = fit_life(uses(windows("mill01", 2, tools("mill01", training=True)), settings), settings)
    growth = {
        name: Parameter(value=value, unit=UNIT, interval_95=(value - half, value + half),
                        determined=True, method="made up")
        for name, (value, half) in K.items()
    }  # fmt: skip
    edges = EdgeGrowth(parameters=growth, tools=5, recordings=119, wear_um=(9.0, 241.0),
                       error_percent=3.0, material=material)  # fmt: skip
    facts = {due.IN_USE: Fact(value="yes"), due.READ: Fact(value=90.0, unit="um"),
             due.READ_AT: Fact(value=30.0), due.TIME: Fact(value=34.5)}  # fmt: skip
    case = JudgedCase(case="T4", group="T4", role="held_out", facts=facts)
    at = folder / "data/champion/mill01/wear"
    at.mkdir(parents=True, exist_ok=True)
    write_json(replace(built.model, lasting=Lasting(life=life, edges=edges)), at / "model.json")
    write_json(replace(built.judged.verdict, cases=(case,)), at / "verdict.json")


def test_simulated_loads_are_those_of_the_worn_edge(project, built) -> None:  # noqa: F811
    def cut(*more: str) -> tuple[dict, str]:
        done = kerf(project, "simulate", "part.nc", *CUT, *more, "--json", "c.json",
                    "--page", "c.html")  # fmt: skip
        assert done.exit_code == 0, done.output
        return json.loads((project / "c.json").read_text())["cut"], done.stdout

    bare, said = cut()
    assert "wear of T4: sharp: the growth of edge forces with wear was not identified" in said
    assert "not identified on this machine" in refused(
        project, "simulate", "part.nc", *CUT, "--wear", "T4=120"
    )
    with_wear(project, built)
    blunt, said = cut("--wear", "T4=120")
    assert "wear of T4: worn to 120 um: as given" in said and "95 %" in said
    torque = [one["by_tool"][0]["torque_Nm"] for one in (bare, blunt)]
    by_hand = 3 * 2e-3 * 6e-3 * 125e6 * 120e-6 / 2  # N a_p R K_te / 2 of a slot
    assert 0.85 * by_hand < torque[1] - torque[0] < by_hand  # its mean over way in and out
    for key in ("peak_load_N", "power_kW", "drive_share", "deflection_um"):
        assert blunt["by_tool"][0][key] > bare["by_tool"][0][key]
    (edge,) = blunt["edges"]
    assert edge["forces"]["peak_load_sharp_N"] == bare["by_tool"][0]["peak_load_N"]
    assert edge["forces"]["peak_load_N"] == blunt["by_tool"][0]["peak_load_N"]
    page = words(project / "c.html")
    assert "Force of each tool, sharp and worn" in page and "T4 counts as worn to 120 µm" in page
    known, said = cut()
    assert "worn to 90 um: as last read, at 30.0 of its 34.5 min in the cut until now" in said
    assert known["edges"][0]["wear_um"] == 90.0
    sharp, said = cut("--wear", "sharp")
    assert sharp["by_tool"] == bare["by_tool"] and "wear of T4: sharp: as asked for" in said
    with_wear(project, built, "A7075")
    _, said = cut("--wear", "T4=120")
    assert "the growth of edge forces was fitted in A7075, not in A6061" in said


@pytest.mark.parametrize(
    ("words_", "said"),
    [
        (("T4=400",), "--wear T4=400 um is beyond the 9 to 241 um"),
        (("T7=40",), "the tool table has no T7, it has T4"),
        (("T4=wide",), "--wear T4=wide is no wear of a tool: give T26=120"),
        (("T4=40", "T4=50"), "--wear gives T4 twice"),
        (("sharp", "criterion"), "--wear criterion is given beside --wear sharp"),
    ],
)
def test_a_wear_that_cannot_count_is_refused(project, built, words_, said) -> None:  # noqa: F811
    with_wear(project, built)
    options = [word for one in words_ for word in ("--wear", one)]
    assert said in refused(project, "simulate", "part.nc", *CUT, *options)


def test_limits_hold_for_the_tool_at_its_criterion(tmp_path, built) -> None:
    """The load limit binds at the worn edge, and the feeds that keep it are lower."""
    folder = new(tmp_path / "project")
    with_wear(folder, built)
    more = ("--feed", "20", "1000", "--speed", "1000", "8000", "--epsilon", "0.5")

    def part(load: str, *wear: str) -> tuple[dict, str]:
        done = kerf(folder, "optimise", "part.nc", *given(limit_load=load), *more, *wear, *OUT)
        assert done.exit_code == 0, done.output
        return json.loads((folder / "better.json").read_text()), done.stdout

    sharp, _ = part("120", "--wear", "sharp")
    worn, said = part("120")
    assert "wear of T1: worn to 215 um: at the criterion of this machine" in said
    assert worn["edges"][0]["wear_um"] == 215.0 and worn["edges"][0]["caution"] == ""
    assert worn["after"]["time_s"] > sharp["after"]["time_s"]
    assert worn["after"]["peak_load_N"] <= 120.0 * (1 + 1e-6)
    assert worn["edges"][0]["forces"]["peak_load_sharp_N"] < 0.9 * 120.0
    assert "T1 counts as worn to 215" in words(folder / "better.html")
    # where the land alone takes more than the limit, tools are to be changed earlier
    early, said = part("60")
    assert 0 < early["edges"][0]["wear_um"] < 215.0 and "limits are kept up to a flank wear" in said
    assert "Change tools by then" in early["warnings"][0]["do"]
    refusal = refused(folder, "optimise", "part.nc", *given(limit_load="60"), *more, *OUT,
                      "--wear", "T1=215")  # fmt: skip
    assert "the edges alone take more" in refusal
