"""A project of one machine with known spindle temperatures, and models of it at will.

The days are those of a network that is known; a model's error is set by its ambient temperature.
"""

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest import mock

import numpy as np
import pandas as pd
import yaml
from sklearn.ensemble import RandomForestRegressor

from pipeline.fleet import Fleet
from pipeline.registry.store import DATABASE, client_of, exists
from pipeline.schema.forest import Trees
from pipeline.schema.golden import Days, FrozenSet, GoldenSets
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.model import Correlation, Parameter, SourceFile, Training
from pipeline.schema.store import write_json
from pipeline.stages.champion import champion
from pipeline.stages.identify import judge
from pipeline.submodels.cases import Roles
from pipeline.submodels.contract import submodel
from pipeline.submodels.spindle.submodel import Judging, SpindleLimits
from pipeline.thermal.network import SOURCES
from pipeline.twin.spindle import (
    TARGET,
    Forest,
    SpindleFitFacts,
    SpindleModelFile,
    SpindleRecords,
    feature_names,
    save_forest,
)
from tests.submodels.spindle.spindle_days import ONE, state_table

MACHINE = "mill01"
TRAINING, GOLDEN, SEALED = "2026-01-05", ("2026-01-19", "2026-01-22"), "2026-01-26"
DAYS = (TRAINING, *(f"2026-01-{day}" for day in range(19, 23)), SEALED)
ROLES = {"training_days": {"first": TRAINING, "last": TRAINING}}
FLEET = Fleet(name="one", machines=(MACHINE,), submodels={"spindle": (MACHINE,)})


def source(day: str) -> SourceFile:
    return SourceFile(file=f"{day}.txt", sha256=sha256(day.encode()).hexdigest())


def project(root: Path, golden: Sequence[str] = GOLDEN, sealed: bool = False) -> Path:
    """Records and parameters of one machine, a golden set, and where asked for a sealed one."""
    clean, signals = root / f"data/clean/{MACHINE}/state", root / f"data/signals/{MACHINE}"
    clean.mkdir(parents=True)
    signals.mkdir(parents=True)
    for number, day in enumerate(DAYS):
        state_table(ONE, number, day, 2.0).reset_index().to_parquet(clean / f"{day}.parquet")
    files = {
        source(day).file: {"sha256": source(day).sha256, "last": f"{day}T16:00:00Z"} for day in DAYS
    }
    (signals / "manifest.json").write_text(json.dumps({"files": files}))
    (root / "params.yaml").write_text(
        yaml.safe_dump(
            {
                "fleet": {"name": FLEET.name, "machines": [MACHINE],
                          "submodels": {"spindle": [MACHINE]}},
                "machine": {
                    MACHINE: {"identity": {"name": MACHINE, "origin": "simulated"},
                              "roles": ROLES, "spindle": {}}
                },
                "spindle_fit": {}, "residual_forest": {},
                "spindle_interval": {}, "spindle_limits": {},
            }
        )
    )  # fmt: skip
    first, last = golden
    chosen = [day for day in DAYS if first <= day <= last]
    sets = GoldenSets(
        machine=MACHINE,
        golden=FrozenSet(files=tuple(map(source, chosen)), days=Days(first=first, last=last)),
        sealed=FrozenSet(files=(source(SEALED),), days=Days(first=SEALED, last=SEALED))
        if sealed
        else None,
    )
    write_json(sets, root / f"data/golden/{MACHINE}.json")
    return root


def spindle(root: Path, error_K: float = 0.0, mae_K: float = 5.0) -> Path:
    """Store and judge the model whose ambient is too high by ``error_K``; its machine's folder."""
    machine = root / f"data/models/{MACHINE}"
    folder = machine / "spindle"
    network = replace(ONE, ambient=ONE.ambient + error_K)
    sources, rng = tuple(SOURCES), np.random.default_rng(0)
    table = rng.normal(size=(60, len(feature_names(sources, ()))))
    trees = RandomForestRegressor(n_estimators=2, max_depth=2, random_state=0)
    save_forest(Trees.of(trees.fit(table, 0.05 * table[:, 0])), folder / "residual")
    model = SpindleModelFile(
        submodel="spindle", machine=MACHINE, origin="simulated",
        parameters={"": {"cooling_rate": Parameter(value=network.cooling_rate, unit="1/s",
                                                   interval_95=None, determined=True, method="")}},
        trained_on=(Training(case=TRAINING, group=TRAINING, files=(source(TRAINING),)),),
        network=network, records=SpindleRecords(), training_days=(TRAINING,),
        fit=SpindleFitFacts(step_s=60.0, nodes=1, rmse_K=0.3, rmse_days_left_out_K={},
                            condition=None, correlation=Correlation(), evaluations=1,
                            seconds=7200, bridged_s=0),
        forest=Forest(used=True, why="", sources=sources, extra=(), days=(TRAINING,), examples=60,
                      rmse_days_left_out_K=None, rmse_without_K=None),
    )  # fmt: skip
    write_json(model, folder / "model.json")
    settings = Judging(
        identity=MachineIdentity(name=MACHINE, origin="simulated"),
        roles=Roles(training_days=Days(first=TRAINING, last=TRAINING)),
        spindle=SpindleRecords(),
        spindle_limits=SpindleLimits(mae_K=mae_K, rmse_K=mae_K),
    )
    reads = {
        "manifest": root / f"data/signals/{MACHINE}/manifest.json",
        "clean": root / f"data/clean/{MACHINE}",
    }
    metrics = root / "metrics.json"
    judge(
        submodel("spindle"),
        reads,
        folder,
        root / "data/golden",
        metrics,
        root / "plots",
        settings=settings,
    )
    return machine


@cache
def empty_store() -> bytes:
    """A store with nothing in it: MLflow makes its tables by fifty migrations, in seconds."""
    with TemporaryDirectory() as folder:
        client_of(Path(folder))
        return (Path(folder) / DATABASE).read_bytes()


@contextmanager
def quick_stores() -> Iterator[None]:
    """Each new SQLite store that MLflow makes is a copy of an empty one, migrated once."""
    from mlflow.store.db import utils

    def initialise(engine: Any) -> None:
        Path(engine.url.database).write_bytes(known)

    known = empty_store()
    with mock.patch.object(utils, "_initialize_tables", initialise):
        yield


def registered(root: Path) -> None:
    """Run the stage ``champion``, as ``dvc repro`` does."""
    if not exists(root):
        (root / DATABASE).write_bytes(empty_store())
    models, champions = root / f"data/models/{MACHINE}", root / "champions.json"
    champion(models, champions, root / f"data/champion/{MACHINE}", fleet=FLEET)


def hour(root: Path) -> pd.DataFrame:
    """An hour of a golden day, from its first measured temperature on."""
    state = pd.read_parquet(root / f"data/clean/{MACHINE}/state/{GOLDEN[0]}.parquet").head(3600)
    assert state[TARGET].notna().iloc[0]
    return state
