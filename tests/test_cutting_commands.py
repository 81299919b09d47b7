"""`kerf simulate` with a blank, tools and a material, as a process engineer uses it."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.parameters import structure
from pipeline.schema.model import Parameter
from pipeline.schema.store import write_json
from tests.report.page_reader import outline, words
from tests.small_project import ROOT
from tests.submodels.cutting import cutting_files
from tests.test_cli import kerf, refused

RECORDINGS = os.environ.get("KERF_RECORDINGS")

PART = """%
O1000(SLOT)
N10 G21 G17 G90 G40
N20 T4 M6
N30 G0 G54 X-10. Y20. S6000 M3
N40 G43 Z5. H4
N50 G1 Z-2. F300.
N60 X70. F900.
N70 G0 Z50.
N80 M30
%
"""
TOOLS = {"description": "made up", "tools": {
    4: {"name": "12 <b>MM</b>", "kind": "flat", "diameter_mm": 12.0, "flutes": 3,
        "stickout_mm": 40},
}}  # fmt: skip
CUT = ("--machine", "mill01", "--stock", "box:0,60,0,40,-10,0", "--tool-table", "tools.yaml",
       "--material", "A6061", "--resolution", "0.5")  # fmt: skip


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.delenv("KERF_RECORDINGS", raising=False)
    folder = tmp_path / "project"
    shutil.copytree(ROOT / "conf", folder / "conf", symlinks=True)
    (folder / "part.nc").write_text(PART)
    (folder / "tools.yaml").write_text(yaml.safe_dump(TOOLS))
    return folder


def simulated(project: Path, *more: str) -> tuple[dict[str, Any], str]:
    """The cut in the document of a simulation, and the lines that it says."""
    done = kerf(project, "simulate", "part.nc", *CUT, *more, "--json", "-")
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)["cut"], done.stderr


def test_each_tool_is_told_with_its_units(project: Path) -> None:
    done = kerf(project, "simulate", "part.nc", *CUT)
    assert done.exit_code == 0, done.output
    lines = done.stdout.splitlines()
    (head,) = [i for i, line in enumerate(lines) if line.split()[:2] == ["tool", "f_z"]]
    assert {"load", "power", "torque", "deflection", "stability", "rate", "life", "cost"} <= set(
        lines[head].split()
    )
    assert {"mm", "N", "kW", "um", "%", "cm3/min", "kWh"} <= set(lines[head + 1].split())
    assert lines[head + 2].split()[0] == "T4" and lines[head + 3].split()[0] == "part"
    assert "(simulated)" in done.stdout


def test_the_json_holds_every_block_and_the_sums(project: Path) -> None:
    assert kerf(project, "simulate", "part.nc", *CUT, "--json", "cut.json").exit_code == 0
    document = json.loads((project / "cut.json").read_text())
    cut = document["cut"]
    assert document["total_time_s"] == pytest.approx(cut["summary"]["time_s"], abs=1e-3)
    (slot,) = [b for b in cut["blocks"] if b["line"] == 8]
    assert slot["feed_per_tooth_mm"] == pytest.approx(900 / 6000 / 3)
    assert slot["peak_load_N"] == pytest.approx(1230 * 2 * 0.05 * (1 + 0.5**2) ** 0.5, rel=0.01)
    assert cut["summary"]["volume_cm3"] == pytest.approx(60 * 12 * 2e-3, rel=0.01)
    assert cut["stock"]["work_offset"] == "G54"
    assert all(value == value for value in slot.values())


def test_the_page_needs_nothing_and_escapes_names(project: Path) -> None:
    assert kerf(project, "simulate", "part.nc", *CUT, "--limit-load", "100", "--json", "cut.json",
                "--page", "cut.html").exit_code == 0  # fmt: skip
    page = outline(project / "cut.html")
    tags = [tag for tag, _ in page.tags]
    assert "script" not in tags and "b" in tags  # the page's own
    said = words(project / "cut.html")
    assert "12 <b>MM</b>" in said and "beyond its limits" in said and "simulated" in said
    assert "cut.json" in said  # where the numbers come from


def test_without_its_options_nothing_is_cut(project: Path) -> None:
    plain = kerf(project, "simulate", "part.nc", "--machine", "mill01", "--json", "times.json")
    assert plain.exit_code == 0 and "cut of" not in plain.stdout
    assert "cut" not in json.loads((project / "times.json").read_text())
    cut = kerf(project, "simulate", "part.nc", *CUT).stdout
    assert cut.startswith(plain.stdout)


def test_a_table_and_costs_of_the_project_are_found_by_name(project: Path) -> None:
    done = kerf(project, "simulate", "part.nc", "--machine", "mill01", "--stock",
                "box:0,60,0,40,-10,0", "--tool-table", "shop", "--material", "steel_medium_carbon",
                "--resolution", "0.5")  # fmt: skip
    assert done.exit_code == 0 and "KRW" in done.stdout
    assert "catalogue: k_c1.1" in done.stdout and "20 to 30 %" in done.stdout


def test_inches_and_a_stated_offset(project: Path) -> None:
    text = PART.replace("G21", "G20").replace("X-10.", "X-.4").replace("Y20.", "Y.8")
    text = text.replace("Z5.", "Z.2").replace("Z-2.", "Z-.1").replace("X70.", "X3.")
    (project / "inch.nc").write_text(text)
    done = kerf(project, "simulate", "inch.nc", *CUT, "--work-offset", "G54", "--json", "c.json")
    assert done.exit_code == 0, done.output
    cut = json.loads((project / "c.json").read_text())["cut"]
    assert cut["summary"]["axial_depth_mm"] == pytest.approx(2.54)


def test_a_measured_response_goes_before_the_modes_of_the_machine(project: Path) -> None:
    for axis in "xy":
        _response(project, f"{axis}.csv", 3000, (900, 2e7))
    cut, said = simulated(project, "--frf", "x=x.csv", "--frf", "y=y.csv")
    fitted = "modes fitted to the measured response x.csv, y.csv, error 0.0 %"
    assert fitted in cut["dynamics"] and fitted in said
    assert cut["lobes"] and cut["summary"]["stability_margin"] is not None


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"--stock": None}, "--tool-table is given without --stock"),
        ({"--tool-table": None}, "--stock is given without --tool-table"),
        ({"--material": None}, "--stock is given without --material"),
        ({"--stock": "box:0,60,0,40"}, "6 numbers"),
        ({"--stock": "sphere:1"}, "box:X0"),
        ({"--stock": "none.stl"}, "none.stl"),
        ({"--tool-table": "lathe"}, "conf/tool/, which has"),
        ({"--tool-table": "part.nc"}, "part.nc is no tool table of conf/tool/: name"),
        ({"--tool-table": "none.yaml"}, "none.yaml does not exist: name one of conf/tool/"),
        ({"--tool-table": "broken.yaml"}, "is no YAML"),
        ({"--tool-table": "wrong.yaml"}, "wrong.yaml"),
        ({"--tool-table": "other.yaml"}, "T4 cuts and is not in the tool table"),
        ({"--material": "cheese"}, "conf/material/, which has"),
        (
            {"--tool-table": "empty.yaml"},
            "empty.yaml is empty: write into it what those of conf/ h",
        ),
        ({"--resolution": "0"}, "--resolution 0.0 mm must lie from 0.001 to 100"),
        ({"--limit-load": "-5"}, "--limit-load -5.0 N must lie above 0"),
        ({"--work-offset": "G59"}, "'G59' is neither in the set-up nor in the program"),
        ({"--frf": "x=none.csv"}, "none.csv does not exist"),
        ({"--frf": "tools.yaml"}, "ending '.yaml'"),
        ({"--frf": "q=tools.yaml"}, "'q'"),
        ({"--unit": "a"}, "has no units: leave --unit out"),
        ({"--tool-table": "twice.yaml"}, "twice.yaml:3: 4 is written twice"),
        ({"--tool-table": "deep.yaml"}, "lie too deep in each other"),
        ({"--machine": "../x"}, "conf/machine/../x.yaml does not exist"),
    ],
)
def test_what_does_not_fit_is_one_sentence(project: Path, change: dict, said: str) -> None:
    (project / "empty.yaml").touch()
    (project / "broken.yaml").write_text("tools: {1: [")
    (project / "wrong.yaml").write_text("tools: {4: {kind: flat, diameter_mm: 12, teeth: 3}}")
    four = "  4: {kind: flat, diameter_mm: 12, flutes: 3}\n"
    (project / "twice.yaml").write_text(f"tools:\n{four}{four}")
    (project / "deep.yaml").write_text("[" * 2_000 + "]" * 2_000)
    (project / "other.yaml").write_text("tools: {5: {kind: flat, diameter_mm: 12, flutes: 3}}")
    options = dict(zip(CUT[::2], CUT[1::2], strict=True)) | change
    given = [word for pair in options.items() if pair[1] is not None for word in pair]
    assert said in refused(project, "simulate", "part.nc", *given)


def test_an_option_of_a_cut_alone_asks_for_the_blank(project: Path) -> None:
    for words_ in (("--limit-load", "60"), ("--page", "p.html"), ("--resolution", "1"),
                   ("--work-offset", "G54"), ("--frf", "x=x.csv")):  # fmt: skip
        said = refused(project, "simulate", "part.nc", "--machine", "mill01", *words_)
        assert f"{words_[0]} is given without --stock" in said


def test_a_program_that_cuts_nothing_says_so(project: Path) -> None:
    (project / "part.nc").write_text("G21 G0 X10.\nM30\n")
    assert "no move cuts" in refused(project, "simulate", "part.nc", *CUT)
    (project / "part.nc").write_text(PART)
    beside = [w if w != CUT[3] else "box:500,560,0,40,-10,0" for w in CUT]
    done = kerf(project, "simulate", "part.nc", *beside, "--page", "p.html")
    assert done.exit_code == 0
    assert "cuts nothing" in words(project / "p.html")
    assert "not where the program cuts: feed moves span X -10..70, Y 20..20" in done.stdout
    assert "the blank X 500..560, Y 0..40, Z -10..0 mm" in done.stdout
    assert "not known: stability, nothing is cut" in done.stdout
    inches = [w if w != CUT[3] else "box:0,2.4,0,1.6,-0.4,0" for w in CUT]
    asked = kerf(project, "simulate", "part.nc", *inches).stdout
    assert "the blank X 0..2.5, Y 0..2, Z -0.4..0 mm (is it in inches? it is read in mm)" in asked
    assert "in inches" not in kerf(project, "simulate", "part.nc", *CUT).stdout
    (project / "part.nc").write_text("%\nM30\n%\n")
    assert "part.nc has no moves" in refused(project, "simulate", "part.nc", *CUT)


def test_a_diameter_in_metre_is_said_on_screen_in_json_and_page(project: Path) -> None:
    table = "tools: {4: {kind: flat, diameter_mm: 0.016, flutes: 3, flute_length_mm: 32.0}}"
    (project / "metre.yaml").write_text(table)
    metre = [w if w != CUT[5] else "metre.yaml" for w in CUT]
    done = kerf(project, "simulate", "part.nc", *metre, "--json", "c.json", "--page", "p.html")
    assert done.exit_code == 0, done.output
    said = "T4 in the tool table metre.yaml: diameter_mm = 0.016 is below the 0.1 mm"
    assert f"warning: {said}" in done.stdout and "metre or inch seems to be meant" in done.stdout
    written = json.loads((project / "c.json").read_text())["cut"]["warnings"]
    assert any(one["what"].startswith(said) for one in written)
    assert said in words(project / "p.html")


def test_rapids_alone_go_through_the_material(project: Path) -> None:
    text = PART.replace("G1 Z-2. F300.", "G0 Z-2.").replace("X70. F900.", "X70.")
    (project / "part.nc").write_text(text)
    done = kerf(project, "simulate", "part.nc", *CUT, "--json", "c.json", "--page", "p.html")
    assert done.exit_code == 0, done.output
    assert "WARNING: rapids go through the material, 1 block, line 8. Retract" in done.stdout
    assert "Where its time goes" in (project / "p.html").read_text()  # as in the report
    (project / "part.nc").write_text(text.replace("G0 Z-2.", "G0 Z2."))
    assert "no move cuts" in refused(project, "simulate", "part.nc", *CUT)


def _response(project: Path, name: str, top: int, *modes: tuple[float, float]) -> None:
    """A measured response of modes, natural frequency [Hz] and stiffness [N/m], up to ``top``."""
    rows = ["frequency [Hz],real [m/N],imaginary [m/N]"]
    for f in range(50, top, 5):
        g = sum(1 / (k * (1 - (f / n) ** 2 + 2j * 0.03 * f / n)) for n, k in modes)
        rows.append(f"{f},{g.real:.9e},{g.imag:.9e}")
    (project / name).write_text("\n".join(rows) + "\n")


def test_a_response_along_one_axis_is_refused(project: Path) -> None:
    _response(project, "x.csv", 3000, (900, 2e7))
    said = refused(project, "simulate", "part.nc", *CUT, "--frf", "x=x.csv")
    assert "nothing is measured along y" in said and "--frf y=FILE" in said


def test_a_response_without_its_mode_is_refused(project: Path) -> None:
    _response(project, "x.csv", 600, (9000, 2e7))
    said = refused(project, "simulate", "part.nc", *CUT, "--frf", "x=x.csv", "--frf", "y=x.csv")
    assert "--frf x.csv, x.csv: frequency response along x" in said and "measure" in said


def test_what_a_response_does_not_show_is_warned_of(project: Path) -> None:
    _response(project, "x.csv", 2000, (900, 2e7), (2200, 4e7))
    _, said = simulated(project, "--frf", "x=x.csv", "--frf", "y=x.csv")
    assert "warning: modes above 1995 Hz, where the measurement along x ends" in said


def test_modes_along_one_axis_are_warned_of(project: Path) -> None:
    path = project / "conf/machine/mill01.yaml"
    kept = [line for line in path.read_text().splitlines() if "{direction: y" not in line]
    path.write_text("\n".join(kept) + "\n")
    done = kerf(project, "simulate", "part.nc", *CUT)
    assert "the tips of T4 have no modes along y" in done.stdout


@pytest.mark.parametrize(
    ("outputs", "said"),
    [
        (("--json", "tools.yaml"), "tools.yaml is read: name another file"),
        (("--json", "conf/new.yaml"), "which is read"),
        (("--json", "a.json", "--page", "./a.json"), "a.json is named for two outputs"),
        (("--json", "a.json", "--page", "/proc/x.html"), "/proc/x.html cannot be written"),
    ],
)
def test_outputs_replace_nothing(project: Path, outputs: tuple[str, ...], said: str) -> None:
    before = sorted(project.iterdir())
    table = (project / "tools.yaml").read_bytes()
    assert said in refused(project, "simulate", "part.nc", *CUT, *outputs)
    assert sorted(project.iterdir()) == before
    assert (project / "tools.yaml").read_bytes() == table


def test_a_spindle_that_stands_cuts_no_chip(project: Path) -> None:
    (project / "part.nc").write_text(PART.replace(" S6000 M3", ""))
    cut, said = simulated(project, "--limit-load", "60", "--page", "p.html")
    assert all(cut["summary"][key] is None for key in ("peak_load_N", "torque_Nm", "power_kW"))
    assert "not known: load, torque and power where the spindle stands" in said


def test_tools_with_one_law_share_its_line(project: Path) -> None:
    tools = {**TOOLS["tools"], 5: TOOLS["tools"][4]}
    (project / "tools.yaml").write_text(yaml.safe_dump({"tools": tools}))
    again = "T5 M6\nS6000 M3\nG0 X-10. Y5.\nG43 Z5. H4\nG1 Z-2. F300.\nX70.\nG0 Z50.\nN80 M30"
    (project / "part.nc").write_text(PART.replace("N80 M30", again))
    assert "forces of T4, T5: " in kerf(project, "simulate", "part.nc", *CUT).stdout


def test_an_identified_law_is_taken_for_its_tool(project: Path) -> None:
    path = project / "data/champion/mill01/cutting/model.json"

    def value(number: float) -> Parameter:
        return Parameter(
            value=number, unit="", interval_95=(number, number), determined=True, method=""
        )

    tool = {"kind": "flat", "diameter_mm": 12, "flutes": 3}
    found = cutting_files.model({"": {"K_tc": value(900.0)}, "spindle": {}})
    found = replace(found, material="A6061", tool=tool)
    write_json(found, path)
    done = kerf(project, "simulate", "part.nc", *CUT)
    assert "forces of T4: identified: K_tc 900" in done.stdout
    before = _energy(project)
    idle = {name: value(v) for name, v in (("p0", 100.0), ("p1", 1.0), ("p2", 0.5))}
    write_json(replace(found, parameters={**found.parameters, "spindle": idle}), path)
    # 100 rev/s: 100 + 100 + 5000 W instead of what the machine's file says
    conf = yaml.safe_load((project / "conf/machine/mill01.yaml").read_text())["spindle_drive"]
    stated = sum(p * 100.0**k for k, p in enumerate(conf["no_load_W"]))
    blocks = json.loads((project / "c.json").read_text())["blocks"]
    first = [block["type"] for block in blocks].index("spindle")
    turning = sum(block["time_s"] for block in blocks[first:])
    drive = structure({"drive": conf}, "drive", SpindleDrive)
    rise = (5200 - stated) / (drive.efficiency * drive.motor_efficiency) * turning / 3.6e6
    assert _energy(project) - before == pytest.approx(rise, rel=1e-3)
    path.write_text("{")
    assert "cutting/model.json is no JSON" in refused(project, "simulate", "part.nc", *CUT)
    path.write_text("[]")
    assert "is not what this version stores" in refused(project, "simulate", "part.nc", *CUT)


def forces(said: str) -> str:
    """The line that says which law the tool has."""
    (line,) = [line for line in said.splitlines() if line.strip().startswith("forces of T4")]
    return line


def test_a_law_of_another_tool_or_material_or_of_the_latest_model_is_not_taken(
    project: Path,
) -> None:
    path = project / "data/champion/mill01/cutting/model.json"
    tool: dict[str, Any] = {"kind": "flat", "diameter_mm": 12, "flutes": 3}
    known = {"": {"K_tc": cutting_files.parameter(900.0, "N/mm^2")}, "spindle": None}
    unknown = {"": {"K_tc": cutting_files.parameter(None, "N/mm^2")}, "spindle": None}
    model = cutting_files.model(known, material="A6061", tool=tool)
    others = (
        replace(model, material="A7075"),
        replace(model, tool=tool | {"diameter_mm": 16}),
        cutting_files.model(unknown, material="A6061", tool=tool),
    )
    for other in others:
        write_json(other, path)
        assert "identified" not in forces(kerf(project, "simulate", "part.nc", *CUT).stdout)
    path.unlink()
    write_json(model, project / "data/models/mill01/cutting/model.json")
    assert "identified" not in forces(kerf(project, "simulate", "part.nc", *CUT).stdout)
    done = kerf(project, "simulate", "part.nc", *CUT, "--model", "latest")
    assert "identified: K_tc 900" in forces(done.stdout)


def _energy(project: Path) -> float:
    assert kerf(project, "simulate", "part.nc", *CUT, "--json", "c.json").exit_code == 0
    return float(json.loads((project / "c.json").read_text())["cut"]["summary"]["energy_kWh"])


def test_the_page_and_the_numbers_are_the_same_each_time(project: Path) -> None:
    for name in ("a", "b"):
        assert kerf(project, "simulate", "part.nc", *CUT, "--json", "cut.json", "--page",
                    f"{name}.html").exit_code == 0  # fmt: skip
    assert (project / "a.html").read_bytes() == (project / "b.html").read_bytes()


@pytest.mark.slow
def test_a_recorded_program_faces_what_lies_above_its_zero(project: Path, tmp_path: Path) -> None:
    """NIST / MTC plate: a face mill takes 0.5 mm off 127 x 76.2 mm, and no rapid cuts."""
    program = Path(RECORDINGS or "", "nist_box/programs/NIST_MTC_CRADA_PLATE-1.NC").resolve()
    if RECORDINGS is None or not program.exists():
        pytest.skip("KERF_RECORDINGS does not name the folder of nist_box")
    diameters = {15: 76.2, 3: 12.7, 4: 6.35, 5: 3.175, 1: 2.3622, 7: 12.7, 23: 3.175}
    tools = {number: {"kind": "drill" if number in (7, 23) else "flat", "diameter_mm": diameter,
                      "flutes": 2} for number, diameter in diameters.items()}  # fmt: skip
    (project / "plate.yaml").write_text(yaml.safe_dump({"tools": tools}))
    done = kerf(project, "simulate", program, "--machine", "hurco", "--stock",
                "box:0,127,-76.2,0,-12.7,0.5", "--tool-table", "plate.yaml", "--material", "A7075",
                "--resolution", "0.5", "--json", "cut.json")  # fmt: skip
    assert done.exit_code == 0, done.output
    cut = json.loads((project / "cut.json").read_text())["cut"]
    faced = cut["by_tool"][0]
    assert faced["tool"] == 15 and faced["volume_cm3"] == pytest.approx(
        12.7 * 7.62 * 0.05, rel=1e-3
    )
    assert not any("rapids" in warning["what"] for warning in cut["warnings"])
    assert cut["summary"]["blank_cm3"] - cut["summary"]["left_cm3"] == pytest.approx(
        cut["summary"]["volume_cm3"], rel=1e-4
    )


DEEP = PART.replace("Z-2. F300.", "Z-9. F300.").replace("X-10. Y20.", "X-20. Y20.")
BODIES = {4: {
    "kind": "flat", "diameter_mm": 12.0, "flutes": 3, "flute_length_mm": 6.0, "stickout_mm": 7.5,
    "shank_diameter_mm": 14.0, "holder_diameter_mm": 30.0,
}}  # fmt: skip
SAID = (
    "line 8: the holder of T4 (⌀ 30 mm from 7.5 mm above the tip) goes 1.5 mm deep into the "
    "material"
)


def test_a_holder_or_shank_that_meets_the_part_is_named_by_every_command(project: Path) -> None:
    (project / "part.nc").write_text(DEEP)
    (project / "tools.yaml").write_text(yaml.safe_dump({"tools": BODIES}))
    blank = [*CUT[:6], *CUT[8:]]
    done = kerf(project, "preflight", "part.nc", *blank)
    assert done.exit_code == 1 and SAID in done.stdout
    assert "line 8: the shank of T4 (⌀ 14 mm from 6 mm above the tip) goes 3 mm" in done.stdout
    found = json.loads(kerf(project, "preflight", "part.nc", *blank, "--json", "-").stdout)
    assert {one["what"] for one in found["violations"]} == {"holder", "shank"}
    assert SAID in kerf(project, "check", "part.nc", "part.nc", *blank).stdout
    cut, said = simulated(project)
    assert SAID in said
    (grave,) = [one for one in cut["warnings"] if "holder" in one["what"]]
    assert grave["grave"] and grave["lines"][0] == 8


def test_tools_whose_holder_is_not_listed_are_said(project: Path) -> None:
    words = "holder of T4 (stickout_mm and holder_diameter_mm in the tool table)"
    done = kerf(project, "preflight", "part.nc", *CUT[:6], *CUT[8:])
    assert done.exit_code == 0 and f"not checked: {words}" in done.stdout
    assert words in kerf(project, "simulate", "part.nc", *CUT).stdout
    assert "not checked: shank and holder" in kerf(project, "preflight", "part.nc", *CUT[:2]).stdout
    assert "--tool-table is missing" in refused(project, "preflight", "part.nc", *CUT[:4])


def test_a_rapid_straight_down_into_the_blank_is_named(project: Path) -> None:
    text = PART.replace("X-10.", "X30.").replace("G1 Z-2. F300.", "Z-2.")
    (project / "part.nc").write_text(text.replace("X70.", "G1 X70."))
    done = kerf(project, "preflight", "part.nc", *CUT[:6], *CUT[8:])
    assert done.exit_code == 1
    assert "line 7: a rapid of T4 goes 2 mm through the material" in done.stdout
    done = kerf(project, "simulate", "part.nc", *CUT)
    assert "WARNING: rapids go through the material, 1 block, line 7. Retract" in done.stdout
