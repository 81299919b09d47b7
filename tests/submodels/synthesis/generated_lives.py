"""Made lives of tools, a generator trained on some of them, and their judgement."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.nets.dcgan_settings import GanSettings, GanTraining
from pipeline.schema.store import read_json, write_json
from pipeline.submodels.cases import Case, Cases, Records, Roles
from pipeline.submodels.contract import Predictor
from pipeline.submodels.judge import Judged, judge
from pipeline.submodels.synthesis.model import SynthesisFitSettings, SynthesisLimits, SynthesisModel
from pipeline.submodels.synthesis.submodel import SUBMODEL, Fitting, Judging
from tests.shared import made_once
from tests.signals.wear_files import IDENTITY, signals_of, wear_records

ROLES = Roles(training=("wear/T[0-5]_*",))
HELD_OUT = ("T6", "T7", "T8")
QUICK = SynthesisFitSettings(
    network=GanSettings(
        latent=16, generator=(16, 12, 8), discriminator=(12, 16), kernel=5, dropout=0.0,
        embedding=16, unknown=0.25,
    ),
    training=GanTraining(
        steps=420, warm=400, batch=24, learning_rate=1e-2, discriminator_rate=1e-3, beta1=0.8,
        spectrum=1.0, average=0.95, every=20,
    ),
    trees=30, wears=8, each=12, judged=40,
)  # fmt: skip
"""Enough for the generator to follow the wear of the made lives."""

SHORT = replace(QUICK, training=GanTraining(steps=3, batch=8, every=1))
"""Enough for a file of a generator."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Built:
    """A generator that was trained, with all that the judge needs."""

    signals: Path
    folder: Path
    cases: Cases
    model: SynthesisModel
    settings: Judging

    def judged(
        self, *, predictor: Predictor | None = None, cases: tuple[Case, ...] | None = None,
    ) -> Judged:  # fmt: skip
        """The verdict of the model, or of another predictor, or on other cases."""
        here = self.cases if cases is None else replace(self.cases, cases=cases)
        return judge(
            self.model, predictor or SUBMODEL.load(self.folder, self.settings), here,
            SUBMODEL.targets(self.settings, self.model), sets=None, files={},
        )  # fmt: skip


def build(
    root: Path, *, wears: Any = None, settings: SynthesisFitSettings = QUICK, roles: Roles = ROLES,
    limits: SynthesisLimits | None = None, **records: Any,
) -> Built:  # fmt: skip
    """Nine made tools, six of them in training; ``wears`` (9, 6) replaces what is told of wear.

    What stands in ``root`` already is not made again.

    Further arguments change section ``wear_records``.
    """
    told = None if wears is None else np.asarray(wears, float)
    signals, folder = root / "signals", root / "model"
    if not folder.exists():
        signals = signals_of(root, tools=9, cuts=6, rows=400, wears=told)
    fitting = Fitting(
        identity=IDENTITY, roles=roles, wear_records=wear_records(**records), synthesis_fit=settings
    )
    cases = SUBMODEL.cases(Records(signals=signals), fitting)
    if not folder.exists():
        folder.mkdir()
        write_json(SUBMODEL.fit(cases, fitting, folder), folder / "model.json")
    model = read_json(folder / "model.json", SynthesisModel)
    judging = Judging(
        identity=IDENTITY, roles=roles, wear_records=wear_records(**records),
        synthesis_limits=limits or SynthesisLimits(),
    )  # fmt: skip
    return Built(signals=signals, folder=folder, cases=cases, model=model, settings=judging)


def once(factory: pytest.TempPathFactory) -> Built:
    """The model of :func:`build`, trained once for all tests of a run; to be read only."""
    return build(made_once(factory, "lives", build))
