"""Section on corrected commands: rows of axes and of the path, what was refused, no file."""

import json
from pathlib import Path
from typing import Any

from pipeline.charts.sources import SourceRegistry
from pipeline.charts.tables import Table
from pipeline.report.evidence import corrected_section


def spread(mean: float) -> dict[str, float]:
    return {"mean": mean, "min": 0.9 * mean, "max": 1.1 * mean}


def place(before: float, after: float) -> dict[str, Any]:
    return {
        "before": {"rms_um": spread(before), "max_um": spread(3 * before)},
        "after": {"rms_um": spread(after), "max_um": spread(3 * after)},
        "share_left": spread(after / before) if before else None,
    }


def written(folder: Path, programs: dict[str, Any]) -> Path:
    path = folder / "mill_command_correction.json"
    document = {"machine": "mill", "origin": "simulated", "programs": programs}
    path.write_text(json.dumps(document))
    return path


def test_every_axis_and_the_path_have_their_rows(tmp_path: Path) -> None:
    cut = place(100.0, 5.0) | {"cutting": place(50.0, 1.0)}
    axes = {"X": {"measured": cut}, "Y": {"measured": place(200.0, 40.0)}}
    one = {"axes": axes, "path": {"carriage": place(10.0, 2.0)}}
    path = written(tmp_path, {"O1": one, "O2": {"refused": "no axis moves"}})
    section = corrected_section(path, SourceRegistry())
    assert section is not None
    (table,) = section.blocks
    assert isinstance(table, Table)
    texts = [[cell.text for cell in row] for row in table.rows]
    assert [row[:4] for row in texts] == [
        ["O1", "X", "at the loop’s sensor", "in cuts"],
        ["O1", "X", "at the loop’s sensor", "whole"],
        ["O1", "Y", "at the loop’s sensor", "whole"], ["O1", "path", "at the carriage", "whole"],
    ]  # fmt: skip
    assert texts[1][4:8] == ["100", "300", "5.00", "15.0"]
    assert [row[-1].replace("\u202f", " ") for row in texts] == ["2.0 %", "5.0 %", "20 %", "20 %"]
    assert "O2: no axis moves" in table.note
    said = section.text[0].replace("\u202f", " ")
    assert "leave 2.0 % to 20 % of the axes’ following error in cuts" in said
    assert len(table.sources) == 1


def test_without_drives_there_is_no_section(tmp_path: Path) -> None:
    assert corrected_section(None, SourceRegistry()) is None
    assert corrected_section(tmp_path / "none.json", SourceRegistry()) is None
    path = written(tmp_path, {"O2": {"refused": "no axis moves"}})
    assert corrected_section(path, SourceRegistry()) is None


def test_a_path_that_is_further_off_is_said(tmp_path: Path) -> None:
    axes = {"X": {"measured": place(100.0, 5.0)}, "Y": {"measured": place(200.0, 40.0)}}
    one = {"axes": axes, "path": {"measured": place(10.0, 59.0)}}
    section = corrected_section(written(tmp_path, {"O1": one}), SourceRegistry())
    assert section is not None
    (table,) = section.blocks
    assert isinstance(table, Table)
    assert table.rows[-1][-1].text.replace("\u202f", " ") == "590 %"
    assert len(section.text) == 3
    assert "further off than as planned in O1 by 177 µm" in section.text[2]
