"""A fitted and judged model of made tool lives, for tests of the sub-model, page and command."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.nets.settings import ResNetSettings, WindowTraining
from pipeline.schema.store import write_json
from pipeline.signals.wear_windows import WearRecords
from pipeline.submodels.cases import Cases, Records, Roles
from pipeline.submodels.judge import Judged, judge
from pipeline.submodels.wear.life import WearLifeSettings
from pipeline.submodels.wear.methods import ForestSettings
from pipeline.submodels.wear.model import WearFitSettings, WearModel
from pipeline.submodels.wear.submodel import SUBMODEL, Fitting, Judging, WearLimits
from tests.signals.wear_files import IDENTITY, signals_of, wear_records

ROLES = Roles(training=("wear/T[0-4]_*",))
"""Five tools are learnt from, T5 to T7 are held out."""
QUICK = WearFitSettings(
    folds=2, forest=ForestSettings(trees=15), network=ResNetSettings(filters=4, kernel=3, blocks=1),
    training=WindowTraining(epochs=3, patience=3, batch=32, learning_rate=0.01),
)  # fmt: skip
NO_NETWORK = WearFitSettings(folds=5, methods=("forest", "ridge"), forest=ForestSettings(trees=15))


@dataclass(frozen=True, kw_only=True)
class Built:
    """Folders, the model, and its judgement."""

    signals: Path
    folder: Path
    model: WearModel
    judged: Judged
    cases: Cases


def judging(roles: Roles = ROLES, records: WearRecords | None = None, **limits: Any) -> Judging:
    """Sections that a judgement reads."""
    return Judging(
        identity=IDENTITY, roles=roles, wear_records=records or wear_records(),
        wear_life=WearLifeSettings(),
        wear_limits=WearLimits(**limits),
    )  # fmt: skip


def build(
    folder: Path, *, signals: Path | None = None, roles: Roles = ROLES,
    settings: WearFitSettings = NO_NETWORK, records: WearRecords | None = None, **changes: Any,
) -> Built:  # fmt: skip
    """Made lives of eight tools, fitted and judged."""
    given = {"tools": 8, "cuts": 7, **changes}
    signals = signals or signals_of(folder, **given)
    records = records or wear_records()
    fitting = Fitting(
        identity=IDENTITY, roles=roles, wear_records=records, wear_life=WearLifeSettings(),
        wear_fit=settings,
    )  # fmt: skip
    found = SUBMODEL.cases(Records(signals=signals), fitting)
    models = folder / "model"
    models.mkdir(exist_ok=True)
    model = SUBMODEL.fit(found, fitting, models)
    write_json(model, models / "model.json")
    return judged(Built(signals=signals, folder=models, model=model, judged=None, cases=found),  # type: ignore[arg-type]
                  roles, records)  # fmt: skip


def judged(built: Built, roles: Roles = ROLES, records: WearRecords | None = None) -> Built:
    """The same model, judged on what its signals hold now."""
    settings = judging(roles, records)
    there = Records(signals=built.signals)
    cases = SUBMODEL.cases(there, settings)
    verdict = judge(
        built.model, SUBMODEL.load(built.folder, settings), cases,
        SUBMODEL.targets(settings, built.model), sets=None, files=there.files,
    )  # fmt: skip
    return Built(
        signals=built.signals, folder=built.folder, model=built.model, judged=verdict, cases=cases
    )
