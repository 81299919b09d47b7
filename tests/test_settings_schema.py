"""Schemas and reference page of settings: true to conf/, and refusing what is wrong."""

import json
import re
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import pytest
import yaml
from jsonschema import Draft202012Validator
from typer.testing import CliRunner

from pipeline.app.commands import app
from pipeline.app.json_schema import classes_below, machine_sections, schema_files, settings
from pipeline.app.machine import write_machine
from pipeline.app.settings_page import page
from pipeline.schema.store import structured
from tests.test_own_machine import DEVICE

ROOT = Path(__file__).parents[1]
FILES = schema_files()
VALIDATORS = {name[:-5]: Draft202012Validator(json.loads(text)) for name, text in FILES.items()}
CONF = [path for kind in VALIDATORS for path in sorted((ROOT / "conf" / kind).glob("*.yaml"))]


def plain(value: Any) -> Any:
    """What YAML says as JSON has it: keys are words, days too."""
    if isinstance(value, dict):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, list):
        return [plain(one) for one in value]
    return value.isoformat() if isinstance(value, date) else value


def read(path: Path) -> Any:
    return plain(yaml.safe_load(path.read_text()))


def faults(kind: str, value: Any) -> list[str]:
    return [
        f"{'.'.join(map(str, one.absolute_path))}: {one.message}"
        for one in VALIDATORS[kind].iter_errors(value)
    ]


@pytest.mark.parametrize("name", FILES)
def test_a_schema_is_one(name: str) -> None:
    Draft202012Validator.check_schema(json.loads(FILES[name]))


@pytest.mark.parametrize("path", CONF, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_every_file_of_conf_fits_its_schema(path: Path) -> None:
    assert not faults(path.parent.name, read(path))


@pytest.mark.parametrize(
    ("keys", "value", "said"),
    [
        (("idenity",), {"name": "x"}, "'idenity' was unexpected"),
        (("drive", "axes", "X", "leed"), 16.0, "'leed' was unexpected"),
        (("control", "axes", "X", "rapid_speed"), 0, "less than or equal to the minimum of 0"),
        (("control", "rapid_mode"), "both", "'both'"),
        (("mapping", "signals", "spindle_sped"), "S1n", "'spindle_sped' was unexpected"),
        (("spindle", "coolant"), "no", "does not match"),
        (("spindle_drive", "base_speed_rpm"), "fast", "does not match"),
        (("records", 0, "format"), "xls", "'xls'"),
        (("records", 0, "files"), None, "None is not of type"),
        (("setup", "work_offsets", "G54"), [1.0, 2.0], "is too short"),
        (("setup", "tools", "four"), {"length": 1.0}, "'four' does not match"),
    ],
)
def test_a_wrong_key_or_value_of_a_machine_is_refused_at_its_place(
    keys: tuple[str | int, ...], value: Any, said: str
) -> None:
    machine = yaml.safe_load((ROOT / "conf/machine/mill01.yaml").read_text())
    place = machine
    for key in keys[:-1]:
        place = place[key]
    place[keys[-1]] = value
    found = VALIDATORS["machine"].iter_errors(plain(machine))
    messages = [m for one in found for m in [one.message, *(c.message for c in one.context)]]
    assert any(said in one for one in messages), messages
    section = str(keys[0])
    if section in machine_sections():  # what the schema refuses, the composition refuses too
        with pytest.raises(ValueError, match=section):
            structured(machine[section], machine_sections()[section], section)


@pytest.mark.parametrize(
    ("kind", "file", "key"),
    [("fleet", "simulated", "machine"), ("material", "brass", "kc11"), ("tool", "shop", "tool")],
)
def test_a_wrong_key_of_a_fleet_a_material_or_a_table_is_refused(
    kind: str, file: str, key: str
) -> None:
    value = read(ROOT / f"conf/{kind}/{file}.yaml")
    assert any(f"'{key}' was unexpected" in one for one in faults(kind, value | {key: 1}))


def test_a_required_key_that_is_missing_is_named() -> None:
    fleet = read(ROOT / "conf/fleet/simulated.yaml")
    del fleet["machines"]
    assert faults("fleet", fleet) == [": 'machines' is a required property"]


def test_what_the_composition_takes_the_schema_takes() -> None:
    machine = yaml.safe_load((ROOT / "conf/machine/mill01.yaml").read_text())
    machine["spindle_drive"]["efficiency"] = "88e-2"  # a word in YAML 1.1
    machine["drive"]["axes"]["X"]["lead"] = "the name of a constant"
    machine["setup"]["block_limit"] = 1e6
    for section in ("spindle_drive", "drive", "setup"):
        structured(machine[section], machine_sections()[section], section)
    machine["energy"] = "${machine.mill02.energy}"
    assert not faults("machine", plain(machine))


def test_an_unknown_submodel_of_a_fleet_is_refused() -> None:
    fleet = read(ROOT / "conf/fleet/simulated.yaml")
    fleet["submodels"]["spindel"] = ["mill01"]
    assert any("'spindel' is not one of" in one for one in faults("fleet", fleet))


def test_each_default_lies_in_the_schema_of_its_setting() -> None:
    document = VALIDATORS["machine"].schema
    seen = 0
    for name, one in document["$defs"].items():
        for key, schema in one["properties"].items():
            if "default" in schema:
                whole = {"$defs": document["$defs"], **schema}
                errors = [
                    e.message for e in Draft202012Validator(whole).iter_errors(schema["default"])
                ]
                assert not errors, f"{name}.{key}: {errors}"
                seen += 1
    assert seen > 200


def test_every_documented_setting_has_its_meaning() -> None:
    silent = [
        f"{cls.__name__}.{one.name}"
        for cls in classes_below(machine_sections())
        if any(one.meaning for one in settings(cls))
        for one in settings(cls)
        if not one.meaning
    ]
    assert not silent


def test_settings_on_one_line_have_each_its_unit() -> None:
    classes = classes_below(machine_sections())
    axis = next(cls for cls in classes if cls.__name__ == "AxisPrior")
    units = {one.name: one.unit for one in settings(axis)}
    assert (units["torque_constant"], units["lead"]) == ("N m/A", "mm/rev")


@dataclass(frozen=True, kw_only=True)
class Stroke:
    """A stroke of an axis."""

    begin: float = 0.0
    speed: float = 1.0
    """Its place [mm] and how fast it is [mm/s]."""
    repeats: int = 1
    """Number of strokes."""


def test_the_meaning_stands_below_the_field_or_the_last_that_shares_it() -> None:
    first, second, third = settings(Stroke)
    assert first.meaning == second.meaning == "Its place [mm] and how fast it is [mm/s]."
    assert (first.unit, second.unit, third.meaning) == ("mm", "mm/s", "Number of strokes.")


def test_the_command_writes_schemas_and_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    place = tmp_path / "reference.md"
    words = ["machine", "schema", "--out", str(tmp_path / "schema"), "--page", str(place)]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    written = {path.name: path.read_text() for path in (tmp_path / "schema").iterdir()}
    assert written == FILES
    assert place.read_text() == page(ROOT / "conf")


def test_a_proposed_machine_names_a_schema_that_is_there_and_fits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "conf/machine").mkdir(parents=True)
    devices = tmp_path / "Devices.xml"
    inside = DEVICE.format(name="one", x="px")
    devices.write_text(f"<MTConnectDevices><Devices>{inside}</Devices></MTConnectDevices>")
    write_machine("lathe", devices, [], None)
    for kind in ("machine", "fleet"):
        path = tmp_path / f"conf/{kind}/lathe.yaml"
        named = re.match(r"# yaml-language-server: \$schema=(\S+)\n", path.read_text())
        assert named, f"{path} names no schema"
        assert json.loads((path.parent / named[1]).read_text())["$defs"] is not None
        assert not faults(kind, read(path))
