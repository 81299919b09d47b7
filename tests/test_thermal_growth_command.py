"""kerf thermal-growth: what it writes and says, the sign, the range in the file, refusals."""

import math
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.schema.store import read_json, write_json
from pipeline.schema.verdict import Verdict
from pipeline.submodels.deformation.model import DeformationModel, Learnt, load_growth_model
from pipeline.submodels.deformation.records import AMBIENT, SPEED
from pipeline.submodels.deformation.submodel import SUBMODEL
from pipeline.thermal.sensors import lag
from tests.served_project import MACHINE, served_project
from tests.served_project import run as run_command
from tests.submodels.deformation.growth_files import NAMES, made, table
from tests.submodels.deformation.test_submodel import QUICK, ROLES, build, recordings

run = partial(run_command, "thermal-growth")
CHANNELS = {
    "recordings": ["growth/*.csv"],
    "temperatures": {name: {"column": name} for name in NAMES},
    "displacement": {"column": "growth"},
    "speed": {"column": SPEED},
    "ambient": {"column": AMBIENT},
}


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("thermal-growth")
    built = build(root / "built", recordings(), replace(QUICK, methods=("linear_sensors",)))
    verdict = read_json(built.folder / "verdict.json", Verdict)
    return served_project(
        root / "project", built.folder, replace(verdict, status="passed", reasons=()),
        built.signals, roles={"training": list(ROLES.training)}, deformation_records=CHANNELS,
    )  # fmt: skip


def judged(project: Path, status: str) -> None:
    """Give the stored verdict another status."""
    path = project / f"data/champion/{MACHINE}/deformation/verdict.json"
    found = read_json(path, Verdict)
    write_json(replace(found, status=status, reasons=("largest error 9 um",)), path)


def test_an_interval_that_the_judge_calls_not_known_is_no_number(project: Path) -> None:
    path = project / f"data/champion/{MACHINE}/deformation/verdict.json"
    verdict = read_json(path, Verdict)
    why = "90 % interval not known: 4 training cases"
    scores = [replace(s, unknown_interval=why) if (s.quantity, s.regime) == ("growth", "") else s
              for s in verdict.scores]  # fmt: skip
    write_json(replace(verdict, scores=tuple(scores)), path)
    status, said = run("--out", "growth.csv")
    assert status == 0 and why in said
    assert "90 % interval of growth: not known" in Path("growth.csv").read_text()


def test_the_table_gives_the_growth_that_the_model_predicts(project: Path) -> None:
    """Worked out here from the file alone, for a recording that nothing was learnt from."""
    status, said = run("--out", "c.csv")
    assert status == 0, said
    rows = pd.read_csv(project / "c.csv", comment="#")
    given = inputs()
    time, growth = 60.0 * np.arange(len(given)), np.zeros(len(given))
    for row in rows.itertuples():
        if row.kind == "start":
            first = 1.0 if row.input == "1" else given[row.input].iloc[0]
            growth += row.um_per_unit * first * (1 - np.exp(-time / row.first_lag_s))
            continue
        values = given[row.input].to_numpy(float)
        values = (values / 1000) ** 2 if row.input == SPEED else values
        values = values - values[0]
        for constant in (row.first_lag_s, row.second_lag_s):
            values = lag(time, values, constant) if constant else values
        growth += row.um_per_unit * values
    served = SUBMODEL.serve(project / f"data/champion/{MACHINE}/deformation")
    assert growth == pytest.approx(served(given.assign(t=time))["growth"].to_numpy(), abs=1e-5)
    assert growth.max() > 3


def inputs() -> pd.DataFrame:
    found = table(made(9)).rename(columns={f"T{k + 1}": name for k, name in enumerate(NAMES)})
    return found.rename(columns={"Speed": SPEED, "Ambient": AMBIENT})


def test_it_says_origin_sign_error_interval_and_range(project: Path) -> None:
    _, said = run("--out", "c.csv")
    text = (project / "c.csv").read_text()
    for words in (said, text):
        assert "rig (simulated)" in words and "+Z" in words and "+growth" in words
        assert "90 % interval" in words and "temperature_1" in words
    assert "exact" in said and "wrote" in said and "c.csv" in said
    learnt = load_growth_model(project / f"data/champion/{MACHINE}/deformation").file.learnt
    rows = pd.read_csv(project / "c.csv", comment="#").set_index("input")
    low, high = rows.loc["temperature_1", ["low", "high"]].iloc[0]
    assert low <= learnt["temperature_1"].low < learnt["temperature_1"].high <= high


class Ran:
    """A control that runs the text: variables, jumps, an alarm; minutes pass by ``now``."""

    def __init__(self, text: str, letter: str) -> None:
        self.lines = [line for line in text.splitlines() if line]
        self.letter, self.now, self.values = letter, 0.0, dict.fromkeys(range(1000), 0.0)
        self.offset, self.alarm = 0.0, ""

    def value(self, expression: str) -> float:
        words = expression.replace("[", "(").replace("]", ")").replace("<>", "!=")
        for word, sign in ((" LT ", "<"), (" GT ", ">"), ("AND", " and "), ("EXP", "math.exp"),
                           ("#3001", "(1000*now)"), ("$AN_POWERON_TIME", "(now/60)")):  # fmt: skip
            words = words.replace(word, sign)
        words = re.sub(rf"{self.letter}(\d+)", r"v[\1]", words)
        return float(eval(words, {"math": math, "v": self.values, "now": self.now}))

    def call(self) -> None:
        labels = {m[1]: k for k, line in enumerate(self.lines)
                  if (m := re.fullmatch(r"(?:N|KERF)(\d+):?", line))}  # fmt: skip
        at = 0
        while at < len(self.lines):
            line = self.lines[at]
            at += 1
            if jump := re.fullmatch(r"IF (.+) GOTO(?:F KERF)? ?(\d+)", line):
                at = labels[jump[2]] if self.value(jump[1]) else at
            elif line in ("M99", "M17"):
                return
            elif line.startswith(("#3000", "SETAL")):
                self.alarm = line
            elif line.startswith(("#5203=", "$SA_TEMP_COMP_ABS_VALUE[Z]=")):
                self.offset = self.value(line.partition("=")[2])
            elif put := re.fullmatch(rf"{self.letter}(\d+)=(.+)", line):
                self.values[int(put[1])] = self.value(put[2])


def ran(project: Path, kind: str) -> tuple[Ran, dict[str, int]]:
    """The control's text, and the variables that the inputs go into."""
    letter = {"fanuc": "#", "siemens": "R"}[kind]
    status, said = run("--out", "text", "--format", kind)
    assert status == 0, said
    text = (project / "text").read_text()
    places = {
        m[2].strip().lower().replace(" ", "_"): int(m[1])
        for m in re.finditer(rf"{letter}(\d+) = ([A-Za-z0-9_ ]+), ", text)
    }
    return Ran(text, letter), places


@pytest.mark.parametrize("kind", ["fanuc", "siemens"])
def test_a_control_that_runs_the_text_moves_away_by_the_growth(project: Path, kind: str) -> None:
    control, places = ran(project, kind)
    control.values[99] = 1.0
    given = inputs()
    time = 60.0 * np.arange(len(given))
    offsets = []
    for minute, row in given.iterrows():
        control.now = 1000.0 + 60.0 * minute
        for name, place in places.items():
            control.values[place] = float(row[name])
        control.call()
        offsets.append(control.offset)
    served = SUBMODEL.serve(project / f"data/champion/{MACHINE}/deformation")
    growth = served(given.assign(t=time))["growth"].to_numpy()
    assert not control.alarm
    assert 1000 * np.array(offsets) == pytest.approx(growth, abs=1e-4)  # mm; nine decimals


@pytest.mark.parametrize("kind", ["fanuc", "siemens"])
def test_a_control_refuses_an_input_beyond_the_range(project: Path, kind: str) -> None:
    control, places = ran(project, kind)
    control.values[99] = 1.0
    for name, place in places.items():
        control.values[place] = float(inputs()[name].iloc[0])
    control.values[places["temperature_1"]] = 200.0
    control.call()
    assert control.alarm and control.offset == 0.0


@pytest.mark.parametrize("kind", ["fanuc", "siemens"])
def test_a_control_refuses_growth_beyond_that_of_training(project: Path, kind: str) -> None:
    path = project / f"data/champion/{MACHINE}/deformation/model.json"
    file = read_json(path, DeformationModel)
    learnt = {**file.learnt, "growth": Learnt(low=-2.0, high=2.0, unit="um")}
    write_json(replace(file, learnt=learnt), path)
    control, places = ran(project, kind)
    control.values[99] = 1.0
    for minute, row in inputs().iterrows():
        control.now = 1000.0 + 60.0 * float(minute)
        for name, place in places.items():
            control.values[place] = float(row[name])
        control.call()
        if control.alarm:
            break
    assert control.alarm and 0 < abs(1000 * control.offset) <= 3.0


def test_a_siemens_text_asks_for_its_sign(project: Path) -> None:
    control, places = ran(project, "siemens")
    for name, place in places.items():
        control.values[place] = float(inputs()[name].iloc[0])
    control.call()
    assert control.alarm


def test_a_fanuc_text_has_no_percent_sign_but_its_own(project: Path) -> None:
    """It ends the program where it stands."""
    run("--out", "text", "--format", "fanuc")
    lines = (project / "text").read_text().splitlines()
    assert [k for k, line in enumerate(lines) if "%" in line] == [0, len(lines) - 1]
    assert all(line.count("(") == line.count(")") <= 1 for line in lines)


@pytest.mark.parametrize("status, words", [("failed", "failed"), ("not judged", "was not judged")])
def test_a_model_that_did_not_pass_is_refused_unless_the_user_says_so(
    project: Path, status: str, words: str
) -> None:
    judged(project, status)
    code, said = run("--out", "c.csv")
    assert code == 2 and f"{words} (largest error 9 um)" in said and "--anyway" in said
    assert not (project / "c.csv").exists()
    code, said = run("--out", "c.csv", "--anyway")
    assert code == 0 and f"WARNING: the growth model {words}" in said
    assert f"verdict: {status}" in (project / "c.csv").read_text()


def test_a_model_no_better_than_no_correction_is_refused_whatever_the_user_says(
    project: Path,
) -> None:
    path = project / f"data/champion/{MACHINE}/deformation/verdict.json"
    verdict = read_json(path, Verdict)
    total = verdict.total("growth")
    assert total is not None and total.baselines["persistence"].rmse is not None
    still = total.baselines["persistence"].rmse
    scores = tuple(replace(one, rmse=still * 2.3) if one is total else one
                   for one in verdict.scores)  # fmt: skip
    write_json(replace(verdict, scores=scores), path)
    for anyway in ((), ("--anyway",)):
        code, said = run("--out", "c.csv", *anyway)
        assert code == 2 and f"without correction by {still:.4g} um" in " ".join(said.split())
        assert not (project / "c.csv").exists()


def without_model(project: Path) -> list[str]:
    shutil.rmtree(project / f"data/champion/{MACHINE}")
    return ["holds no model: rig needs three temperatures or more"]


def without_recordings(project: Path) -> list[str]:
    shutil.rmtree(project / f"data/signals/{MACHINE}")
    return ["manifest"]


@pytest.mark.parametrize("broken", [without_model, without_recordings])
def test_what_lacks_a_file_is_refused(project: Path, broken: Callable[[Path], list[str]]) -> None:
    words = broken(project)
    code, said = run("--out", "c.csv")
    assert code == 2 and all(word in said for word in words), said
    assert not (project / "c.csv").exists()


def test_unknown_words_are_refused(project: Path) -> None:
    assert (
        "'dxf' is not one of 'csv', 'fanuc', 'siemens'" in run("--out", "c", "--format", "dxf")[1]
    )
    assert "not one of 'champion', 'latest'" in run("--out", "c", "--model", "best")[1]


def test_the_latest_model_is_named(project: Path) -> None:
    code, said = run("--out", "c.csv", "--model", "latest")
    assert code == 0 and "data/models/rig, not with the champion" in said
