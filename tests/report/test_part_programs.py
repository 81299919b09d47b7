"""What the pages say of optimised part programs, and of what the shop floor cut."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from optimise_documents import optimised, part
from page_reader import every_word
from report_folders import FLEET, empty_machine, machine, reported

from pipeline.report.cut.page import write_cut_page
from pipeline.report.folders import MachineFolders
from pipeline.report.optimised.page import write_optimised_page
from pipeline.report.pages import write_report
from pipeline.report.programs.simulated import Program
from pipeline.schema.program_cut import CutProgram, SimulatedProgram
from pipeline.schema.store import write_json
from tests.report.test_cut_page import made
from tests.submodels.cutting import cutting_files


def cuts(above_before: int = 20, above_after: int = 0, seeds: int = 20) -> dict[str, Any]:
    """What the simulated shop floor says of one part."""

    def side(seconds: float, peak: float, above: int) -> dict[str, Any]:
        return {"time_s": {"mean": seconds, "min": seconds - 0.1, "max": seconds + 0.1},
                "peak_load_N": {"mean": peak, "max": peak + 1.5}, "above": above}  # fmt: skip

    return {"seeds": seeds, "before": side(29.9, 73.0, above_before),
            "after": side(24.6, 56.4, above_after)}  # fmt: skip


def with_parts(
    root: Path, folders: MachineFolders, documents: dict[str, dict], trial: dict | None = None
) -> MachineFolders:
    """``folders`` with the documents of optimised programs, and of their trial cuts."""
    parts = root / "parts" / folders.name
    parts.mkdir(parents=True)
    for label, document in documents.items():
        (parts / f"{label}.json").write_text(json.dumps(document))
    cut = root / "trials" / f"{folders.name}.json"
    if trial is not None:
        cut.parent.mkdir(parents=True, exist_ok=True)
        cut.write_text(json.dumps({"parts": trial}))
    return replace(folders, parts=parts, trial=cut if trial else None)


def page(tmp_path: Path, documents: dict[str, dict], trial: dict | None = None, **other) -> Path:
    folders = with_parts(tmp_path, machine(tmp_path, "m", days=3, **other), documents, trial)
    write_report([folders], FLEET, None, tmp_path / "out")
    return tmp_path / "out" / "m.html"


def test_predicted_stands_beside_cut(tmp_path: Path) -> None:
    text = every_word(page(tmp_path, {"SLOT": optimised()}, {"SLOT": cuts(20, 1)}))
    assert "Time, s 29.48 29.90 24.51 24.60" in text
    assert "Peak load, N 71.2 73.0 57.9 56.4" in text
    assert "Above the limit of 60.0 N – 20 of 20 0.71 % 1 of 20" in text
    # 24.51 / 24.60 - 1
    assert "it took 24.60 s instead of 29.90 s, and its time was predicted with an error of" in text
    assert "an error of −0.4 %; its peak load was predicted with an error of" in text
    assert "passed the limit of the load in 1 of them, the program as it was in 20" in text


def test_each_program_is_told_with_gain_price_and_proof(tmp_path: Path) -> None:
    found = page(tmp_path, {"SLOT": optimised(), "BORE": optimised(name="BORE")})
    text = every_word(found)
    assert "SLOT least cost 29.48 24.51 −16.9 % 120.1 76.40 −36.4 % 71.2 57.9 60.0 proved" in text
    assert "in 0.71 % of parts (0.30 % to 1.4 %), 1 % is allowed; being that sure costs" in text
    assert "a1" * 32 in text
    programs = found.with_name("m_programs.html").read_text()
    assert all(f'href="m_program_{name}.html"' in programs for name in ("SLOT", "BORE"))
    assert "cut on the simulated shop floor" not in text


def test_a_program_s_page_in_the_report_is_that_of_the_command(tmp_path: Path) -> None:
    found = page(tmp_path, {"SLOT": optimised()}).with_name("m_program_SLOT.html")
    alone = tmp_path / "alone.html"
    write_optimised_page(part(optimised()), alone, tmp_path / "parts/m/SLOT.json")
    both = [re.findall(r'<section id="([a-z-]+)"', one.read_text()) for one in (found, alone)]
    assert both[0] == both[1] and len(both[0]) > 8
    figures = [re.findall(r"<svg.*?</svg>", one.read_text(), re.S) for one in (found, alone)]
    assert figures[0] == figures[1]


@pytest.mark.parametrize(("simulated", "name"), [
    ("", "SLOT as written"), ("S.nc", "S.nc"), ("SLOT", "SLOT as written"),
])  # fmt: skip
def test_a_program_as_written_has_the_page_of_the_command(
    tmp_path: Path, simulated: str, name: str
) -> None:
    """Where the report shows it simulated too, that page is the one of its cut."""
    cut = replace(made().cut, axes=(), edges=())
    folders = with_parts(tmp_path, machine(tmp_path, "m", days=3), {"SLOT": optimised()})
    time = SimulatedProgram(program="SLOT", machine="m", origin="simulated", file="parts/S.nc")
    write_json(CutProgram(time=time, cut=cut), tmp_path / "parts/m/as_written/SLOT.json")
    if simulated:
        sure = replace(time, program=simulated, total_time_90_s=(29.0, 31.0))
        write_json(sure, tmp_path / f"programs/m/{simulated}.json")
    write_report([folders], FLEET, None, tmp_path / "out")
    found = tmp_path / f"out/m_program_{name.replace(' ', '_')}.html"
    alone = tmp_path / "alone.html"
    shown = Program(summary=replace(time, program=name), moves=None, cut=cut)
    write_cut_page(shown, alone, tmp_path / "parts/m/as_written/SLOT.json")
    for of in (r'<section id="([a-z-]+)"', r"(?s)<svg.*?</svg>"):
        shared = re.sub(r'(?s)<section id="recorded".*?</section>', "", found.read_text())
        assert re.findall(of, shared) == re.findall(of, alone.read_text())
    assert "has not cut a program of this name" in found.read_text()  # what only a log can say
    assert ("90\u202f% interval 29.0\u202fs to 31.0\u202fs" in found.read_text()) is bool(simulated)
    programs = (tmp_path / "out/m_programs.html").read_text()
    assert [
        f'href="{page.name}"' in programs for page in (tmp_path / "out").glob("m_program_*.html")
    ] == [True, True]
    assert f'{found.name}">As written<' in (tmp_path / "out/m_program_SLOT.html").read_text()


def test_two_parts_of_one_program_have_a_page_as_written_each(tmp_path: Path) -> None:
    cut = replace(made().cut, axes=(), edges=())
    parts = {"A": optimised(), "B": optimised()}
    folders = with_parts(tmp_path, machine(tmp_path, "m", days=3), parts)
    time = SimulatedProgram(program="S", machine="m", origin="simulated", file="parts/S.nc")
    write_json(time, tmp_path / "programs/m/S.json")
    for label in parts:
        own = replace(cut, stock=replace(cut.stock, text=f"blank of {label}"))
        document = CutProgram(time=replace(time, program=label), cut=own)
        write_json(document, tmp_path / f"parts/m/as_written/{label}.json")
    write_report([folders], FLEET, None, tmp_path / "out")
    for label in parts:
        text = (tmp_path / f"out/m_program_{label}.html").read_text()
        (written,) = re.findall(r'href="([^"]*)">As written<', text)
        shown = (tmp_path / "out" / written).read_text()
        assert f"blank of {label}" in shown
        assert re.findall(r'href="([^"]*)">Optimised<', shown) == [f"m_program_{label}.html"]


def test_the_head_says_which_program_to_load(tmp_path: Path) -> None:
    better = optimised(name="BORE")
    better["gain"]["cost_percent"] = -40.2
    found = every_word(page(tmp_path, {"SLOT": optimised(), "BORE": better}))
    bore, slot = (found.index(f"Review {name}") for name in ("parts/m/BORE.nc", "parts/m/SLOT.nc"))
    assert bore < slot
    assert "before it is cut Program BORE Predicted 40 % less cost, inside its limits" in found
    assert "process engineer" in found[bore:slot]


@pytest.mark.parametrize("gain", [-0.99, 0.0, 5.0, None])
def test_a_gain_below_a_percent_changes_no_program(tmp_path: Path, gain: float | None) -> None:
    document = optimised()
    document["gain"]["cost_percent"] = gain
    text = every_word(page(tmp_path, {"SLOT": document}))
    assert "Review" not in text


def test_a_program_that_is_not_proved_must_not_be_loaded(tmp_path: Path) -> None:
    document = optimised()
    document["proof"] |= {"same": False, "first": "SLOT.nc:14: X10. became X1."}
    text = every_word(page(tmp_path, {"SLOT": document}))
    assert "Do not load parts/m/SLOT.nc Program SLOT It is not proved to make the same" in text
    assert "Review" not in text
    assert "First difference: SLOT.nc:14: X10. became X1." in text


@pytest.mark.parametrize(("above", "loads"), [(0, True), (1, True), (2, False), (20, False)])
def test_trial_cuts_beyond_the_limit_speak_against_a_program(
    tmp_path: Path, above: int, loads: bool
) -> None:
    """At 1 % of 20 cuts one may pass by chance (18 % of such trials), two hardly (2 %)."""
    text = every_word(page(tmp_path, {"SLOT": optimised()}, {"SLOT": cuts(20, above)}))
    refused = f"On the simulated shop floor {above} of 20 cuts passed the limit of 60.0 N"
    assert (refused in text) is not loads
    assert ("36 % less cost, inside its limits" in text) is loads


def test_a_program_that_passes_a_limit_is_not_to_be_loaded(tmp_path: Path) -> None:
    document = optimised()
    document["after"]["beyond"] = 2
    text = every_word(page(tmp_path, {"SLOT": document}))
    assert "2 blocks pass a limit." in text and "less cost, inside its limits" not in text


@pytest.mark.parametrize("passed", [True, False])
def test_loads_that_rest_on_forces_that_failed_are_doubted(tmp_path: Path, passed: bool) -> None:
    folders = machine(tmp_path, "m", days=3)
    judged = cutting_files.verdict(cutting_files.run(1200, 4.0 if passed else 31.0))
    write_json(cutting_files.model(), folders.models / "cutting" / "model.json")
    write_json(judged, folders.models / "cutting" / "verdict.json")
    folders = replace(folders, submodels=("spindle", "cutting"))
    folders = with_parts(tmp_path, folders, {"SLOT": optimised()})
    text = reported(tmp_path, folders)
    assert ("Do not load it yet: the forces of this machine’s cut" in text) is not passed
    assert ("less cost, inside its limits" in text) is passed


def test_a_failed_machine_is_not_told_to_load_a_program(tmp_path: Path) -> None:
    text = every_word(page(tmp_path, {"SLOT": optimised()}, passed=False))
    assert "spindle temperature failed" in text and "Review" not in text


def test_a_document_of_another_shape_is_named_and_does_not_break_the_page(tmp_path: Path) -> None:
    documents = {"A": {}, "B": optimised() | {"proof": None}, "SLOT": optimised()}
    text = every_word(page(tmp_path, documents, {"SLOT": {"seeds": "many"}}))
    assert "SLOT least cost 29.48" in text and "SLOT: predicted" not in text
    for name in ("A.json", "B.json", "trials/m.json"):
        assert name in text


def test_a_machine_without_programs_has_no_section_and_no_key_figure(tmp_path: Path) -> None:
    write_report([empty_machine(tmp_path, "m")], FLEET, None, tmp_path / "out")
    said = (tmp_path / "out/report.json").read_text() + every_word(tmp_path / "out/m.html")
    assert "parts_before_s" not in said and "Part programs" not in said


@pytest.mark.parametrize(
    ("what", "source", "said"),
    [
        ("K_tc (T1)", "identified on this machine", "Forces: identified on this machine."),
        ("coefficients (T1)", "Liu et al. 2021, table 5, carbide",
         "Forces: Liu et al. 2021, not identified on this machine."),
    ],
)  # fmt: skip
def test_a_proposed_program_says_where_its_forces_come_from(
    tmp_path: Path, what: str, source: str, said: str
) -> None:
    document = optimised()
    document["certainty"]["uncertain"] = [
        {"what": what, "value": "K_tc 1230 N/mm²", "spread": "± 10 %", "source": source}
    ]
    assert said in every_word(page(tmp_path, {"SLOT": document}))


@pytest.mark.parametrize(
    ("status", "said"),
    [("passed", "Forces: identified on this machine."),
     ("not identified", "Forces: published values, none identified on this machine.")],
)  # fmt: skip
def test_forces_of_a_program_without_drawn_quantities_follow_the_sub_model(
    tmp_path: Path, status: str, said: str
) -> None:
    document = optimised() | {"certainty": None}
    document["verdicts"] = [{"submodel": "cutting", "figures": "peak loads", "status": status}]
    assert said in every_word(page(tmp_path, {"SLOT": document}))
