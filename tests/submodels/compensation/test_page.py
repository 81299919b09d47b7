"""Page of the following error that is left over: its words, tables and figures, from few files."""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch

from pipeline.charts.sections import Figures as Drawn
from pipeline.charts.sections import SubModelPage
from pipeline.charts.sources import SourceRegistry
from pipeline.charts.tables import Table
from pipeline.nets.sequence import sequence_network
from pipeline.nets.sequence_settings import CnnLstmAttentionSettings, WindowTraining
from pipeline.nets.stored import Scaling
from pipeline.nets.window_model import TrainedSequence
from pipeline.nets.windows import WindowInput
from pipeline.schema.interval import Band
from pipeline.schema.model import Condition
from pipeline.schema.verdict import Fact, Figures, JudgedCase, Score, Verdict
from pipeline.submodels.compensation.attention import attention_shown, to_and_fro
from pipeline.submodels.compensation.model import (
    ESTIMATION,
    PREDICTION,
    Compensation,
    CompensationModel,
    KindScore,
    LeakShown,
    SearchFacts,
    UseModel,
    key_of,
)
from pipeline.submodels.compensation.page import page
from pipeline.submodels.contract import Shown

INPUTS = tuple(WindowInput(name=n) for n in ("speed", "acceleration", "since reversal"))
BANDS = {"": Band(lower=1.0, upper=1.0, n=100, groups=5)}
LENGTH, STEP = 12, 0.004
SCORES = {
    "twin alone": KindScore(rmse_um=2.0, max_um=9.0, spread_um=0.2),
    "arx": KindScore(rmse_um=0.5, max_um=3.0, spread_um=0.1),
    "cnn_lstm_attention": KindScore(rmse_um=0.8, max_um=4.0, spread_um=0.1),
}
LATE = {"persistence": SCORES["twin alone"], "arx": SCORES["arx"]}


def made(scores: Mapping[str, KindScore], **changes: Any) -> UseModel:
    one = UseModel(champion="arx", scores=scores, bands=BANDS, inputs=INPUTS)
    return replace(one, **changes)


def model_of(axes: dict[str, dict[str, UseModel]], **changes: Any) -> CompensationModel:
    one = CompensationModel(
        submodel="compensation", machine="rig", origin="simulated", parameters={}, trained_on=(),
        conditions={"highest speed X": Condition(unit="mm/s", low=0.0, high=100.0)},
        axes=axes, step_s=STEP, horizon_s=0.02, settle_s=0.1, length=LENGTH,
        search=SearchFacts(
            kind="cnn_lstm_attention", axis="X", method="genetic", candidates=11, pruned=3,
            history_um=(0.6, 0.5, 0.5), chosen={"units": 64.0, "l2": 1e-4},
            bounds_hit={"units": "upper"},
        ),
        leak=LeakShown(
            axis="X", kind="cnn_lstm_attention", inputs=("position",), rmse_um=0.07,
            honest_um=0.8, max_um=0.5, honest_max_um=4.0,
        ),
    )  # fmt: skip
    return replace(one, **changes)


def judged(quantity: str, base: str) -> Verdict:
    def score(group: str, after: float, before: float) -> Score:
        return Score(
            quantity=quantity, unit="um", group=group, regime="", role="held_out", n=200,
            rmse=after / 4, max=after, baselines={base: Figures(rmse=before / 4, max=before)},
        )  # fmt: skip

    def case(name: str, role: Any, speed: float) -> JudgedCase:
        at = {"highest speed X": Fact(value=speed, unit="mm/s")}
        return JudgedCase(case=name, group=name, role=role, conditions=at)

    return Verdict(
        submodel="compensation", machine="rig", origin="simulated", status="passed", reasons=(),
        judged_role="held_out", golden=None,
        scores=(score("a.csv", 1.0, 4.0), score("b.csv", 2.5, 8.0), score("all", 2.5, 8.0)),
        cases=(case("a.csv", "held_out", 25.0), case("b.csv", "held_out", 50.0),
               case("c.csv", "training", 25.1)),
    )  # fmt: skip


def predicted(quantity: str, base: str) -> pd.DataFrame:
    t = 0.01 * np.arange(200)
    frames = []
    for case, left in (("a.csv", 1.0), ("b.csv", 2.5)):
        after = left * np.exp(-(((t - 1.2) / 0.05) ** 2))
        frames.append(pd.DataFrame({
            "case": case, "group": case, "role": "held_out", "quantity": quantity, "unit": "um",
            "regime": "", "t": t, "measured": 50.0 + after, "predicted": 50.0, "low": 49.0,
            "high": 51.0, "scored": True, f"baseline_{base}": 50.0 - 2 * after,
        }))  # fmt: skip
    return pd.concat(frames, ignore_index=True)


@pytest.fixture()
def shown(tmp_path: Path) -> Shown:
    quantity = "following error X"
    return Shown(
        machine="rig", origin="simulated", shelf=SourceRegistry(), folder=tmp_path,
        model=model_of({"X": {PREDICTION: made(SCORES), ESTIMATION: made(LATE)}}),
        verdict=judged(quantity, "twin alone"), predictions=predicted(quantity, "twin alone"),
    )  # fmt: skip


def with_attention(model: CompensationModel) -> CompensationModel:
    kind = CnnLstmAttentionSettings(filters=3, units=4)
    built = sequence_network(kind, LENGTH, len(INPUTS), torch.Generator().manual_seed(1))
    one = TrainedSequence(
        kind=kind, settings=WindowTraining(), precision="float32", length=LENGTH, inputs=INPUTS,
        leaks=(), network=built, history=np.ones((1, 3)), validation_groups=(),
        x_scaling=Scaling(shift=np.zeros(3), scale=np.array([0.1, 1.0, 2.0])),
        y_scaling=Scaling(shift=np.array(0.0), scale=np.array(1e-6)),
    )  # fmt: skip
    key = key_of("X", PREDICTION, "cnn_lstm_attention")
    served = Compensation(file=model, documents={key: (one.document(),)})
    return replace(model, attention=attention_shown(served, {}))


def plain(text: str) -> str:
    return text.replace("\u00a0", " ").replace("\u202f", " ")


def said(found: SubModelPage) -> str:
    return plain(" ".join(words for s in found.sections for words in s.text))


def tables(found: SubModelPage) -> list[Table]:
    return [b for s in found.sections for b in s.blocks if isinstance(b, Table)]


def captions(found: SubModelPage) -> list[str]:
    return [plain(f.caption) for s in found.sections for b in s.blocks
            if isinstance(b, Drawn) for f in b.figures]  # fmt: skip


def test_the_headline_holds_the_errors_with_and_without_and_the_command(shown: Shown) -> None:
    found = page(shown).verdict
    assert found is not None and found.status == "passed"
    words = plain(found.sentence)
    assert "On 2 recordings not learnt from" in words
    assert "on X by up to 2.50 µm (RMS 0.62 µm; drive model alone up to 8.00 µm" in words
    assert "ARX serves" in words and "CNN-LSTM with attention, is not the best here" in words
    assert "kerf simulate PROGRAM --machine rig --compensate FILE" in found.todo


def test_the_published_kind_is_not_blamed_where_it_serves(shown: Shown) -> None:
    best = made(SCORES, champion="cnn_lstm_attention")
    found = page(replace(shown, model=model_of({"X": {PREDICTION: best}})))
    assert "CNN-LSTM with attention serves" in said(found)
    assert "not the best" not in said(found)


def test_the_table_says_what_is_gone_and_which_speed_was_not_learnt(shown: Shown) -> None:
    rows = [[plain(c.text) for c in row] for row in tables(page(shown))[0].rows]
    assert rows[0][:5] == ["b", "3 000", "no", "2.00 / 8.00",
                           "0.62 / 2.50"]  # fmt: skip
    assert rows[0][-1] == "69"  # 1 - 2.5 / 8
    assert rows[1][:3] == ["a", "1 500", "yes"]
    assert rows[2][0] == "all together"


def test_the_worst_recording_is_drawn_whole_and_close_to_its_greatest_error(shown: Shown) -> None:
    whole, close = captions(page(shown))[:2]
    assert "in b, not learnt from: drive model alone, error up to 7.50 µm" in whole
    assert "ARX leaves up to 2.50 µm" in whole
    assert "0.8 to 1.6 s" in close


def test_leak_search_and_bounds_stand_in_sentences(shown: Shown) -> None:
    words = said(page(shown))
    assert "would read 0.07 µm instead of 0.80 µm" in words and "refused" in words
    assert "11 candidates trained, 3 of them stopped early. Chosen: units 64" in words
    assert "bound of units (upper)" in words
    assert any("from 0.60 µm to 0.50 µm" in one for one in captions(page(shown)))


@pytest.mark.parametrize("lacking", [("verdict",), ("predictions",), ("verdict", "predictions"),
                                     ("model",), ("model", "verdict", "predictions")])  # fmt: skip
def test_what_is_not_there_is_left_out_or_said(shown: Shown, lacking: tuple[str, ...]) -> None:
    none: dict[str, Any] = dict.fromkeys(lacking)
    found = page(replace(shown, **none))
    for name in lacking[:1] if "model" in lacking else lacking:
        assert {"model": "model.json", "verdict": "verdict.json",
                "predictions": "predictions.parquet"}[name] in said(found)  # fmt: skip
    if "verdict" in lacking and "model" not in lacking:
        assert found.verdict is not None and found.verdict.status == "unknown"
        assert found.compared["compensation_max_um"].value is None


def test_a_machine_without_recorded_commands_is_estimated_only(shown: Shown) -> None:
    quantity = "following error, estimated X"
    found = page(replace(
        shown, model=model_of({"X": {ESTIMATION: made(LATE, by_time=True)}}, with_drive=False,
                              search=None, leak=None),
        verdict=judged(quantity, "persistence"), predictions=predicted(quantity, "persistence"),
    ))  # fmt: skip
    words = said(found)
    assert found.verdict is not None and "kerf simulate" not in found.verdict.todo + words
    assert "measurements that are 20.0 ms old or older" in words
    assert "stretches of time left out" in words and "no model of its drives" in words
    assert "drive model" not in words + " ".join(captions(found))
    assert "last error known up to 8.00 µm" in words


def test_a_verdict_that_failed_advises_against_the_command(shown: Shown) -> None:
    assert shown.verdict is not None
    failed = replace(shown.verdict, status="failed", reasons=("the interval holds too few",))
    found = page(replace(shown, verdict=failed)).verdict
    assert found is not None and found.status == "failed"
    assert "the interval holds too few" in found.sentence and "no corrected command" in found.todo


def test_attention_is_shown_by_regime_where_the_network_is_there(shown: Shown) -> None:
    assert not any("attention over the window" in one for one in captions(page(shown)))
    assert shown.model is not None
    model = with_attention(shown.model)
    found = model.attention
    assert found is not None and found.axis == "X"
    weights = found.weights
    assert set(weights) == {"at rest", "after a reversal", "accelerating", "constant speed"}
    for values in weights.values():
        assert sum(values) == pytest.approx(1.0, abs=1e-5)
    assert len(found.ms) == len(values) and found.ms[-1] > -1e3 * STEP * LENGTH
    drawn = captions(page(replace(shown, model=model)))
    assert any("attention over the window" in one for one in drawn)


def test_the_motion_to_and_fro_ends_where_it_began_at_the_speed_asked() -> None:
    way = to_and_fro(0.05)
    assert way[-1] == pytest.approx(0.0, abs=1e-12)
    assert np.abs(np.diff(way)).max() / 0.001 == pytest.approx(0.05)


def test_importing_the_page_does_not_import_torch() -> None:
    import subprocess
    import sys

    code = "import sys, pipeline.submodels.compensation.page; print('torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert re.fullmatch(r"False\s*", done.stdout)
