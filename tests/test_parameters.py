"""params.yaml: what does not fit is refused with the path of its key."""

import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from pipeline.cutting.economics.cost import CostRates
from pipeline.cutting.economics.material import Material
from pipeline.cutting.tool import ToolTable
from pipeline.fleet import Fleet, missing
from pipeline.parameters import ParametersError, read_params, section_path, structure
from pipeline.stages.compose import composed
from pipeline.twin.command_correction import CommandCorrectionSettings

CONF = Path(__file__).parents[1] / "conf"


@dataclass(frozen=True, kw_only=True)
class Inner:
    files: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Section:
    step_s: float
    count: int = 3
    ambient: bool = False
    name: str = ""
    days: tuple[float, ...] = ()
    parts: tuple[Inner, ...] = ()
    scales: dict[str, float] = field(default_factory=dict)
    limit: float | None = None

    def __post_init__(self) -> None:
        if not self.step_s > 0:
            raise ValueError(f"step_s = {self.step_s} s must be positive")


def loaded(**values: Any) -> Section:
    return structure({"machine": {"mill": {"fit": values}}}, "machine.mill.fit", Section)


def test_a_section_is_loaded_with_its_types() -> None:
    found = loaded(
        step_s=1, count=4, ambient=True, days=[1, 2.5], parts=[{"files": ["a"]}],
        scales={"x": 2}, limit=3,
    )  # fmt: skip
    assert found == Section(
        step_s=1.0, count=4, ambient=True, days=(1.0, 2.5), parts=(Inner(files=("a",)),),
        scales={"x": 2.0}, limit=3.0,
    )  # fmt: skip
    assert isinstance(found.step_s, float)
    assert loaded(step_s=1.0, limit=None).limit is None


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"step_s": 1, "stepp_s": 2}, r"stepp_s.*@ machine\.mill\.fit$"),
        ({}, r"required field missing @ machine\.mill\.fit\.step_s"),
        ({"step_s": "soon"}, r"'soon' is no number @ machine\.mill\.fit\.step_s"),
        ({"step_s": True}, "True is no number"),
        ({"step_s": None}, "None is no number"),
        ({"step_s": -2}, r"step_s = -2\.0 s must be positive @ machine\.mill\.fit"),
        ({"step_s": 1, "count": 3.5}, r"3\.5 is no whole number @ machine\.mill\.fit\.count"),
        ({"step_s": 1, "count": float("inf")}, "inf is no whole number"),
        ({"step_s": 1, "count": "3"}, "'3' is no whole number"),
        ({"step_s": 1, "ambient": "no"}, r"'no' is neither true nor false @ .*\.ambient"),
        ({"step_s": 1, "ambient": 0}, "0 is neither true nor false"),
        ({"step_s": 1, "name": None}, "None is no word"),
        ({"step_s": 1, "name": ["a"]}, "is no word"),
        ({"step_s": 1, "days": "12"}, r"'12' is no list @ machine\.mill\.fit\.days"),
        ({"step_s": 1, "days": [1, "b"]}, r"'b' is no number @ machine\.mill\.fit\.days\[1\]"),
        ({"step_s": 1, "parts": [{"files": "ab"}]}, r"'ab' is no list @ .*parts\[0\]\.files"),
        ({"step_s": 1, "parts": [{"file": []}]}, r"file.*parts\[0\]"),
    ],
)
def test_what_does_not_fit_is_named_with_its_path(values: dict[str, Any], words: str) -> None:
    with pytest.raises(ParametersError, match=words):
        loaded(**values)


def test_a_number_that_yaml_reads_as_a_word_is_one_all_the_same() -> None:
    values = yaml.safe_load("{step_s: 1e-3}")
    assert values == {"step_s": "1e-3"}
    assert loaded(**values).step_s == 1e-3


@given(
    st.fixed_dictionaries(
        {},
        optional={
            name: st.one_of(
                st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=3),
                st.lists(st.integers(), max_size=2),
                st.dictionaries(st.text(max_size=1), st.none()),
            )
            for name in ("step_s", "count", "ambient", "name", "days", "parts", "scales", "more")
        },
    )
)  # fmt: skip
def test_any_section_is_loaded_as_it_stands_or_refused(values: dict[str, Any]) -> None:
    try:
        found = loaded(**values)
    except ParametersError as error:
        assert "machine.mill.fit" in str(error)
        return
    assert found.ambient is values.get("ambient", False)
    assert found.count == values.get("count", 3)
    assert list(found.days) == list(values.get("days", []))


def test_a_section_that_is_missing_or_empty_is_named() -> None:
    with pytest.raises(ParametersError, match=r"no section machine\.mill\.fit: add it in conf/"):
        structure({"machine": {"mill": {}}}, "machine.mill.fit", Section)
    with pytest.raises(ParametersError, match="fit is None, a mapping"):
        structure({"fit": None}, "fit", Section)


def test_the_machines_own_section_goes_first() -> None:
    values = {"fit": 1, "machine": {"mill": {"fit": 2}, "lathe": {"other": 3}, "new": None}}
    assert section_path(values, "fit", "mill") == "machine.mill.fit"
    assert section_path(values, "fit", "lathe") == "fit"
    assert section_path(values, "fit", "new") == "fit"
    assert section_path(values, "fit", None) == "fit"
    with pytest.raises(ParametersError, match=r"no section machine\.mil, known machines.*'mill'"):
        section_path(values, "fit", "mil")


def test_a_file_that_is_no_mapping_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "params.yaml"
    with pytest.raises(ParametersError, match="does not exist: run `dvc repro compose`"):
        read_params(path)
    path.write_text("a: [")
    with pytest.raises(ParametersError, match="is no YAML"):
        read_params(path)
    path.write_text("- a")
    with pytest.raises(ParametersError, match="holds list"):
        read_params(path)


def test_a_fleet_knows_its_machines_and_what_each_lacks() -> None:
    some = ("mill",)
    names = ("spindle", "control", "drive", "cutting")
    fleet = Fleet(name="two", machines=("mill", "lathe"), submodels=dict.fromkeys(names, some),
                  optimised=some)  # fmt: skip
    assert fleet.submodels_of("mill") == names and fleet.submodels_of("lathe") == ()
    assert missing(fleet, "mill") == []
    heat, control, drives, cuts, parts = missing(fleet, "lathe")
    assert "spindle temperature" in heat[0] and "temperature" in heat[1]
    assert "program times" in control[0] and "the programs" in control[1]
    assert "feed drives" in drives[0] and "current" in drives[1]
    assert "cutting force" in cuts[0] and "dynamometer" in cuts[1]
    assert "or the load of the spindle with the executed line" in cuts[1]
    assert "faster or cheaper" in parts[0] and "tool table, material and limits" in parts[1]
    with pytest.raises(
        ValueError, match=r"fleet\.submodels\.spindle names \['saw'\].*add it there"
    ):
        Fleet(name="two", machines=("mill",), submodels={"spindle": ("saw",)})


@pytest.mark.parametrize(
    ("lists", "said"),
    [
        (
            {"optimised": ("mill",)},
            r"fleet\.optimised names \['mill'\], which fleet\.submodels\.control does not",
        ),
        ({"trials": ("mill",)}, r"fleet\.trials names \['mill'\], which fleet\.optimised"),
        (
            {"submodels": {"control": ("mill",)}, "optimised": ("mill",), "trials": ("mill",)},
            r"fleet\.trials names \['mill'\], which fleet\.simulated",
        ),
    ],
)
def test_a_list_that_needs_another_says_so(lists: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        Fleet(name="one", machines=("mill",), **lists)


def test_a_number_or_the_name_of_what_holds_it() -> None:
    @dataclass(frozen=True, kw_only=True)
    class Known:
        gain: float | str
        limit: float | str | None = None

    def known(gain: object, limit: object = None) -> Known:
        return structure({"a": {"gain": gain, "limit": limit}}, "a", Known)

    assert known("1e-3", 4) == Known(gain=1e-3, limit=4.0)
    assert known("gtau", "kp") == Known(gain="gtau", limit="kp")
    assert isinstance(known(3).gain, float)
    with pytest.raises(ParametersError, match="is no word"):
        known(True)
    with pytest.raises(ParametersError, match="is no word"):
        known(None)


def test_a_word_that_is_none_of_those_allowed_is_said_with_them() -> None:
    @dataclass(frozen=True, kw_only=True)
    class Choice:
        method: Literal["least_squares", "genetic"] = "genetic"

    assert structure({"a": {"method": "least_squares"}}, "a", Choice).method == "least_squares"
    with pytest.raises(ParametersError, match="'annealing' is none of least_squares, genetic"):
        structure({"a": {"method": "annealing"}}, "a", Choice)


@pytest.mark.parametrize(("group", "wanted"), [("material", Material), ("tool", ToolTable)])
def test_each_file_of_a_catalogue_is_the_section_of_its_name(group: str, wanted: type) -> None:
    values = yaml.safe_load(composed(CONF))
    files = {p.stem: yaml.safe_load(p.read_text()) for p in (CONF / group).glob("*.yaml")}
    assert values[group] == files
    for name in files:
        structure(values, f"{group}.{name}", wanted)


def test_the_costs_are_a_section() -> None:
    rates = structure(yaml.safe_load(composed(CONF)), "cost", CostRates)
    assert rates.currency == "KRW" and rates.labour_per_h == 9160.0


def test_a_catalogue_may_be_left_out_and_its_file_must_have_a_name(tmp_path: Path) -> None:
    conf = tmp_path / "conf"
    shutil.copytree(CONF, conf, symlinks=True)
    shutil.rmtree(conf / "material")
    assert "material" not in yaml.safe_load(composed(conf))
    (conf / "material").mkdir()
    (conf / "material/steel 1.0503.yaml").write_text("name: C45\n")
    with pytest.raises(ValueError, match=r"material/steel 1\.0503\.yaml has no name for a section"):
        composed(conf)


@pytest.mark.parametrize(
    "text",
    ["- name", "name: C45", *(pytest.param(t, marks=pytest.mark.proof) for t in ("steel", ""))],
)
def test_a_file_of_a_catalogue_that_is_no_entry_is_refused_by_its_path(
    text: str, tmp_path: Path
) -> None:
    conf = tmp_path / "conf"
    shutil.copytree(CONF, conf, symlinks=True)
    (conf / "material/steel.yaml").write_text(text)
    values = yaml.safe_load(composed(conf))
    with pytest.raises(ParametersError, match=r"material\.steel"):
        structure(values, "material.steel", Material)


def test_a_section_by_its_old_name_is_said() -> None:
    with pytest.raises(ParametersError, match="it was called correction, rename it in conf/"):
        structure({"correction": {}}, "command_correction", CommandCorrectionSettings)
    with pytest.raises(ValueError, match="compensation is called following_residual now"):
        Fleet(name="mine", machines=("a",), submodels={"compensation": ("a",)})
