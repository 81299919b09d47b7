"""Signals of wear as a sub-model: cases are lives of tools, judged on those that were held out."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from pipeline.schema.arrays import packed
from pipeline.schema.golden import GoldenSets
from pipeline.schema.model import Condition, LeftOut, SourceFile
from pipeline.schema.store import read_json, write_json
from pipeline.schema.verdict import Fact, Role, significant
from pipeline.signals.wear_lives import read_lives
from pipeline.signals.wear_windows import ToolLife, WearRecords, WearWindows
from pipeline.submodels.cases import Case, Cases, Records, conditions_of, held, role_of
from pipeline.submodels.contract import (
    Input,
    Prediction,
    Predictor,
    Sections,
    SubModel,
    Target,
)
from pipeline.submodels.synthesis.fit import Trained, curves, looks, trained
from pipeline.submodels.synthesis.judging import (
    AUGMENTED,
    COPY,
    GENERATED,
    LEARNT,
    MEAN,
    NEAREST,
    ORDERS,
    RECORDED,
    SPECTRUM,
    SPREAD,
    TITLES,
    compared,
)
from pipeline.submodels.synthesis.model import (
    FOREST,
    NETWORK,
    GeneratorFile,
    Life,
    Synthesis,
    SynthesisFitSettings,
    SynthesisLimits,
    SynthesisModel,
    load_synthesis,
)


@dataclass(frozen=True, kw_only=True)
class Fitting(Sections):
    """Sections of params.yaml that the fit reads."""

    wear_records: WearRecords
    synthesis_fit: SynthesisFitSettings


@dataclass(frozen=True, kw_only=True)
class Judging(Sections):
    """Sections of params.yaml that the judgement reads."""

    wear_records: WearRecords
    synthesis_limits: SynthesisLimits


class SynthesisOfSignals(SubModel[Fitting, Judging, SynthesisModel]):
    """Windows of signals at a given wear of the tool and given conditions."""

    name: ClassVar[str] = "synthesis"
    title: ClassVar[str] = "generated signals of wear"
    needs: ClassVar[str] = (
        "forces, vibrations or currents of whole tool lives, five tools or more, with the wear "
        "measured in between"
    )
    reads: ClassVar[tuple[str, ...]] = ("signals", "wear")
    model: ClassVar[type] = SynthesisModel
    fitting: ClassVar[type] = Fitting
    judging: ClassVar[type] = Judging
    inputs: ClassVar[tuple[Input, ...]] = (
        Input(name="wear", unit="um"),
        Input(name="conditions of the cut", unit=""),
    )

    def targets(self, settings: Judging, model: SynthesisModel) -> tuple[Target, ...]:
        """Wear of generated windows, learners, spread, copies, spectra."""
        limits, unit = settings.synthesis_limits, model.wear_unit
        wear = {"rmse": limits.rmse_class if model.is_class else limits.rmse_um}
        found = [
            *(
                Target(
                    quantity=GENERATED, unit=unit, regime=judge, limits=wear,
                    baselines=(RECORDED, NEAREST, MEAN), must_beat=(MEAN,), titles=TITLES,
                )
                for judge in model.judges
            ),
            Target(
                quantity=LEARNT, unit=unit, baselines=(RECORDED, MEAN), must_beat=(MEAN,),
                titles=TITLES,
            ),
            Target(quantity=AUGMENTED, unit=unit, baselines=(RECORDED, MEAN)),
            Target(quantity=SPREAD, unit="1", limits={"mean_percent": limits.spread_percent}),
            Target(quantity=COPY, unit="1", limits={"mean_percent": limits.copy_percent}),
        ]  # fmt: skip
        for channel in model.channels:
            found.append(Target(quantity=SPECTRUM, unit="dB", regime=channel, baselines=(NEAREST,)))
            found.append(Target(quantity=ORDERS, unit="dB", regime=channel))
        return tuple(found)

    def cases(
        self, records: Records, settings: Fitting | Judging, sets: GoldenSets | None = None
    ) -> Cases:
        """Lives of tools, for training where all recordings are; ValueError: unreadable file."""
        if records.signals is None:
            raise ValueError("lives of tools stand in the signals: name them in reads")

        def role(name: str, file: str) -> Role:
            return role_of([name, file], settings.roles, sets)

        found = read_lives(
            records.signals, settings.wear_records,
            lambda name: role(name, name) == "training",
        )  # fmt: skip
        cases = []
        for life in found.lives:
            roles = [role(one.name, one.file) for one in life.files]
            cases.append(
                Case(
                    name=life.tool,
                    group=life.tool,
                    role=_role(roles),
                    load=held(Life(windows=life.windows, wear=records.wear)),
                    conditions=_conditions(life),
                    files=tuple(SourceFile(file=one.name, sha256=one.sha256) for one in life.files),
                )
            )
        left_out = tuple(LeftOut(case=n, reason=why) for n, why in found.left_out.items())
        return Cases(cases=tuple(cases), left_out=left_out)

    def fit(self, cases: Cases, settings: Fitting, folder: Path) -> SynthesisModel:
        """The generator of the training tools' windows."""
        training = cases.of("training")
        if not training:
            first = next((f"; {one.case}: {one.reason}" for one in cases.left_out), "")
            raise ValueError(
                f"no tool whose wear is known is learnt from{first}: name recordings of one in "
                "roles.training"
            )
        lives: list[Life] = [case.load() for case in training]
        windows = WearWindows.joined([one.windows for one in lives])
        fitting, progress = settings.synthesis_fit, settings.wear_records.progress
        found = trained(windows, fitting, (progress,) if progress else ())
        judges = judges_of(lives[0].wear, windows.wear_unit)
        model = SynthesisModel(
            submodel=self.name,
            machine=settings.identity.name,
            origin=settings.identity.origin,
            parameters={},
            trained_on=tuple(case.training for case in training),
            left_out=cases.left_out,
            conditions={
                name: one for name, one in conditions_of(training).items()
                if name in ("lowest wear", "highest wear")
            } | _learnt(found),
            channels=windows.channels,
            units=windows.units,
            rate_Hz=windows.rate_Hz,
            length=windows.values.shape[2],
            wear_unit=windows.wear_unit,
            windows=found.windows,
            steps=fitting.training.steps,
            curves={},
            within=found.collapse.within,
            between=found.collapse.between,
            faults=found.collapse.reasons,
            judges=(FOREST, NETWORK) if judges else (FOREST,),
            clipped=found.gan.scaling.clipped,
            judged=fitting.judged,
            neighbours=fitting.neighbours,
            trees=fitting.trees,
            seed=fitting.seed,
        )  # fmt: skip
        _write(found, folder, judges)
        # the curve is read from what was stored, in its precision
        write_json(model, folder / "model.json")
        served = load_synthesis(folder)
        read = curves(served, fitting, model.judges)
        seen = looks(served, found.earlier, read[model.judges[0]], fitting)
        return replace(model, curves=read, looks=seen)

    def load(self, folder: Path, settings: Judging) -> Predictor:
        """Predictor of lives."""
        served = load_synthesis(folder)
        return lambda case: _predicted(case, served)

    def serve(self, folder: Path) -> Callable[[pd.DataFrame], pd.DataFrame]:
        """Windows at the wear and conditions of each row, in long form.

        The table has a column for each condition, and may have ``seed``, the same for all rows.
        The result has ``window``, ``sample`` and a column for each channel.
        """
        served = load_synthesis(folder)

        def sample(table: pd.DataFrame) -> pd.DataFrame:
            seed = int(table["seed"].iloc[0]) if "seed" in table.columns and len(table) else 0
            names = [name for name in table.columns if name != "seed"]
            made = served.gan.sample({name: table[name].to_numpy() for name in names}, seed=seed)
            many, length = made.shape[0], made.shape[2]
            columns = {name: made[:, k].ravel() for k, name in enumerate(served.gan.channels)}
            return pd.DataFrame(
                {
                    "window": np.repeat(np.arange(many), length),
                    "sample": np.tile(np.arange(length), many),
                    **columns,
                }
            )

        return sample

    def example(self, folder: Path) -> pd.DataFrame:
        """Two windows in the middle of the conditions that were learnt."""
        space = load_synthesis(folder).gan.space
        row: dict[str, Any] = {one.name: 0.5 * (one.low + one.high) for one in space.continuous}
        row |= {one.name: one.words[0] if one.words else "" for one in space.discrete}
        return pd.DataFrame([row, row])

    def curves(self, folder: Path) -> Mapping[str, Sequence[float]]:
        """Losses of discriminator and generator, and the judge's error, over the training."""
        steps = read_json(folder / "generator.json", GeneratorFile).document["history"]
        looks = read_json(folder / "model.json", SynthesisModel).looks
        return {
            "discriminator": [one[1] for one in steps], "generator": [one[2] for one in steps],
            "judge": [one.mae for one in looks],
        }  # fmt: skip


def judges_of(folder: Path | None, wear_unit: str) -> tuple[Mapping[str, Any], ...]:
    """Networks of a wear model, none without one; ValueError when the file is broken."""
    path = None if folder is None else folder / "methods.json"
    if path is None or not path.exists():
        return ()
    try:
        found = tuple(json.loads(path.read_text())["networks"])
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{path} is no file of the wear model: run `dvc repro`") from error
    return tuple(one for one in found if one.get("wear_unit") == wear_unit)


def _role(roles: Sequence[Role]) -> Role:
    """Role of a life: a frozen set goes first; it is learnt from where every recording is."""
    for one in ("sealed", "golden", "held_out"):
        if one in roles:
            return one
    return "training"


def _conditions(life: ToolLife) -> dict[str, Fact]:
    """Range of wear of a life, and words of its conditions where there is one each."""
    wear, unit = life.windows.wear, life.windows.wear_unit
    found = {
        "lowest wear": Fact(value=significant(wear.min(), 4), unit=unit),
        "highest wear": Fact(value=significant(wear.max(), 4), unit=unit),
    }
    for name, values in life.windows.conditions.items():
        several = np.unique(values)
        if len(several) == 1 and not np.issubdtype(values.dtype, np.number):
            found[name] = Fact(value=str(several[0]))
    return found


def _learnt(found: Trained) -> dict[str, Condition]:
    """Ranges and words of the generator's conditions."""
    space = found.gan.space
    ranges = {c.name: Condition(unit=c.unit, low=c.low, high=c.high) for c in space.continuous}
    return ranges | {d.name: Condition(words=d.words) for d in space.discrete}


def _write(found: Trained, folder: Path, judges: tuple[Mapping[str, Any], ...]) -> None:

    mine = found.reference
    reference = {name: packed(np.asarray(getattr(mine, name), np.float32)) for name in vars(mine)}
    others = tuple(
        {"document": gan.document(), "generated": packed(made.astype(np.float32))}
        for gan, made in found.others
    )
    document = GeneratorFile(
        document=found.gan.document(), reference=reference, judges=judges, others=others
    )
    write_json(document, folder / "generator.json")


def _predicted(case: Case, served: Synthesis) -> Prediction:
    life: Life = case.load()
    windows = life.windows
    if windows.channels != served.file.channels or windows.wear_unit != served.file.wear_unit:
        raise ValueError(
            f"{case.name} has channels {windows.channels}, the generator {served.file.channels}: "
            "run `dvc repro` after a change of wear_records"
        )
    return compared(windows, served, case.name, again=case.role != "training")


SUBMODEL = SynthesisOfSignals()
"""The sub-model, as the contract finds it."""
