"""Section on siblings: how far a machine's own records moved its values; shown, never used."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from page_reader import section, words
from report_folders import machine

from pipeline.fleet import Fleet
from pipeline.report.texts import ReportSettings
from pipeline.schema.model import Parameter
from pipeline.schema.store import read_json, write_json
from pipeline.stages.report import report
from pipeline.twin.spindle import SpindleModelFile

TYPES = {"m1": "VMC 850", "m2": "VMC 850", "m3": "VMC 850", "lathe": "TL 20", "own": ""}


def known(value: float, share: float) -> Parameter:
    ends = (value * (1 - share), value * (1 + share))
    return Parameter(value=value, unit="1/s", interval_95=ends, determined=True, method="fit")


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report's stage over machines whose manifests name their types."""
    root = tmp_path_factory.mktemp("siblings")
    unknown = Parameter(value=None, unit="K/s", interval_95=None, determined=False, method="flat")
    rates = {"m1": known(1e-3, 0.02), "m2": known(1.2e-3, 0.9), "m3": known(1.1e-3, 0.1)}
    for name, kind in TYPES.items():
        folders = machine(root, name, "recorded", days=3)
        manifest = folders.signals / "manifest.json"
        head = {"machine": {"name": name, "type": kind, "origin": "recorded"}}
        manifest.write_text(json.dumps({**head, **json.loads(manifest.read_text())}))
        path = folders.models / "spindle/model.json"
        model = read_json(path, SpindleModelFile)
        copper = known(0.1, 0.1) if name == "m1" else unknown
        parameters = {"": {"cooling_rate": rates.get(name, rates["m1"]),
                           "copper": replace(copper, unit="K/s")}}  # fmt: skip
        nodes = 2 if name == "m3" else 1
        write_json(replace(model, parameters=parameters, fit=replace(model.fit, nodes=nodes)), path)
    names = (
        "signals clean models champion golden truth programs parts trials history ledger "
        "twin_state condition incidents settings out metrics"
    )
    paths = [root / one for one in names.split()]
    fleet = Fleet(name="hall", machines=tuple(TYPES), submodels={"spindle": tuple(TYPES)})
    report(*paths, fleet=fleet, budget="default", pages=ReportSettings())
    return root / "out"


def test_a_page_says_how_far_own_records_moved_the_values(pages: Path) -> None:
    sharp, vague = (section(pages / f"{name}_spindle.html", "siblings") for name in ("m1", "m2"))
    assert "Pooled with m2, of the same type (VMC 850)" in sharp
    assert "Nothing uses these values" in sharp
    assert (
        "moved 1 value by 100 %" in sharp.replace("\u202f", " ")
        and "of the way from the sibling’s value" in sharp
    )
    assert "A single sibling says little" in sharp
    assert "do not determine 1 value, which the sibling proposes" in vague
    assert "0.1, proposed" in vague.replace("0.100", "0.1")
    assert "data/models" not in sharp or "sha256" in sharp


def test_another_structure_another_type_and_none_are_not_pooled(pages: Path) -> None:
    assert (
        "Not pooled with m3, of the same type: its network has another number of nodes"
        in section(pages / "m1_spindle.html", "siblings")
    )
    alone = section(pages / "m3_spindle.html", "siblings")
    assert "Not pooled with m1 and m2, of the same type: its" in alone
    only = section(pages / "lathe_spindle.html", "siblings")
    assert "No other machine of type TL 20" in only
    assert "sibling" not in words(pages / "own_spindle.html").lower()
