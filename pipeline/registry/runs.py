"""Registering a bundle: one run with settings, key figures, curves, hashes and the pyfunc."""

import json
import shutil
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.charts import svg
from pipeline.charts.numbers import number
from pipeline.charts.sources import hash_of_files
from pipeline.registry.provenance import (
    flat,
    key_figures,
    model_of_bundle,
    parameters_of,
    plain,
    provenance,
    requirements,
    training_files,
)
from pipeline.registry.sqlite import BUNDLE_TAG, Version
from pipeline.registry.store import (
    client_of,
    experiment_of,
    logged_model,
    made_by_another,
    model_name,
    reached,
    versions,
)
from pipeline.schema.bundle import PREDICTIONS, SERVED, VERDICT, Bundle, Served, copy_bundle
from pipeline.schema.model import Model
from pipeline.schema.predictions import first_judged, read_predictions, shown_predictions
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Score, Status, Verdict

if TYPE_CHECKING:
    import pandas as pd


METRICS = 1000
"""Values of curves that MLflow takes at once [1]."""
BATCH = 100
"""Parameters that MLflow takes in one call."""
ROLES = {"golden": "golden records", "held_out": "records held out of the fit"}
"""Records that a verdict rests on, in words."""
GRAVEST: tuple[Status, ...] = ("failed", "not decided", "not judged", "passed")
"""Order of the sub-models in a card."""
LONGEST = 5000
"""Characters of a description that every store of MLflow takes."""
DIGEST = 32
"""Characters of a data set's hash that MLflow takes."""
HEAD = "# Digital twin"
"""Begin of a card; what the gate said of the version stands above it."""
MOST = 8
"""Reasons, conditions and cases of a kind that a card names."""
SIDE, MARGIN = 420, 60
"""Side of the square of the figure, and what its words take on each side [px]."""

MadeWith = Callable[[], Mapping[str, Any]]
"""Settings that a bundle was made with, read only when it is logged."""


def register(
    bundle: Bundle, folder: Path, root: Path = Path(), *, made_with: MadeWith = dict,
    numbers: Mapping[int, str],
) -> Version:  # fmt: skip
    """Version of a bundle; logged and registered unless its content is there already.

    ``folder`` holds the bundle; ``made_with`` settings are logged with the run; ``numbers`` are the
    hashes of the bundles that a history knows by their versions, see :func:`_numbered`.
    Raises ValueError when the registry cannot be opened or written.
    """
    there = [v for v in versions(bundle.machine, root) if v.bundle == bundle.sha256]
    if there:
        return there[0]
    client = client_of(root)
    with reached("written"):
        _log(bundle, folder, root, experiment_of(client, root), made_with(), numbers)
    return next(v for v in versions(bundle.machine, root) if v.bundle == bundle.sha256)


def renumber(version: Version, root: Path, numbers: Mapping[int, str]) -> int:
    """New number of a version whose number is that of another bundle; see :func:`_numbered`.

    One that a run which broke off has given it already stays.
    Raises ValueError when the registry cannot be read or written.
    """
    client, name, old = client_of(root), model_name(version.machine), str(version.version)
    given = [v.version for v in versions(version.machine, root)
             if v.bundle == version.bundle == numbers.get(v.version, v.bundle)]  # fmt: skip
    with reached("written"):
        stored = client.get_model_version(name, old)
        number = given[0] if given else _numbered(
            client, name, numbers, version.tags, source=stored.source, run=version.run,
            description=version.description, model_id=logged_model(stored),
        )  # fmt: skip
        for alias in version.aliases:
            client.set_registered_model_alias(name, alias, str(number))
        client.delete_model_version(name, old)
    return number


def _numbered(
    client: Any, name: str, numbers: Mapping[int, str], tags: Mapping[str, str], *, source: str,
    run: str, description: str, model_id: str,
) -> int:  # fmt: skip
    """Number of a new version: its bundle's own one, else one after all that the history knows.

    MLflow counts on from the highest number that it has given, deleted ones included
    (``max_version + 1`` in ``sqlalchemy_store.create_model_version``), so versions are added and
    deleted until it comes to the number.  One is there when it has the tag of its bundle.
    """
    sha256, last = tags[BUNDLE_TAG], max(numbers, default=0)
    others = {key: value for key, value in tags.items() if key != BUNDLE_TAG}
    while True:
        made = client.create_model_version(
            name, source, run, tags=others, model_id=model_id, description=description
        )
        number = int(made.version)
        if number > last or numbers.get(number) == sha256:
            client.set_model_version_tag(name, made.version, BUNDLE_TAG, sha256)
            return number
        client.delete_model_version(name, made.version)


def _log(
    bundle: Bundle,
    folder: Path,
    root: Path,
    experiment: str,
    made_with: Mapping[str, Any],
    numbers: Mapping[int, str],
) -> None:
    import mlflow

    signature, units = _described(bundle, folder)
    tags = provenance(bundle, folder, root, made_with)  # units stand in the model's metadata
    mlflow.set_experiment(experiment)
    card = model_card(bundle, folder, units)
    with mlflow.start_run(run_name=f"{bundle.machine}-{bundle.sha256[:8]}") as run:
        parameters = list(flat(made_with).items())
        for first in range(0, len(parameters), BATCH):
            mlflow.log_params(dict(parameters[first : first + BATCH]))
        figures = {name: key_figures(name, folder / name) for name in bundle.submodels}
        mlflow.log_metrics({key: one for some in figures.values() for key, one in some.items()})
        _log_curves(bundle, folder, root)
        mlflow.set_tags(tags | {"mlflow.note.content": as_description(card)})
        mlflow.log_text(card, "model_card.md")
        sets = [_training_set(name, folder / name, root) for name in bundle.submodels]
        try:
            client_of(root).log_inputs(run.info.run_id, sets)
        except mlflow.MlflowException:  # somebody else has logged the same set at this moment
            client_of(root).log_inputs(run.info.run_id, sets)
        _log_identifications(bundle, folder, root, figures)
        model_id = _log_pyfunc(bundle, folder, root, signature, units, run.info)
    client, name = client_of(root), model_name(bundle.machine)
    if not client.search_registered_models(f"name='{name}'"):
        with made_by_another():
            client.create_registered_model(name)
    _numbered(client, name, numbers, tags, source=f"models:/{model_id}", run=run.info.run_id,
              description=as_description(card), model_id=model_id)  # fmt: skip


def _log_pyfunc(
    bundle: Bundle,
    folder: Path,
    root: Path,
    signature: Any,
    units: Mapping[str, Mapping[str, str]],
    run: Any,
) -> str:
    """Log the bundle as a pyfunc of a run, without ``mlflow.pyfunc.log_model``'s extras; its id."""
    import mlflow
    from mlflow.entities import LoggedModelOutput, LoggedModelStatus

    from pipeline.submodels.contract import submodel

    client, package = client_of(root), Path(__file__).parents[1]
    logged = client.create_logged_model(run.experiment_id, name="bundle", source_run_id=run.run_id)
    first = _first(bundle)
    with tempfile.TemporaryDirectory() as scratch:
        copy_bundle(folder, bundle, Path(scratch) / "bundle")
        code = Path(scratch) / package.name
        shutil.copytree(package, code, ignore=shutil.ignore_patterns("__pycache__", ".*"))
        mlflow.pyfunc.save_model(
            str(Path(scratch) / "model"),
            python_model=str(package / "serving.py"),
            artifacts={"bundle": str(Path(scratch) / "bundle")},
            code_paths=[str(code)],
            signature=signature,
            input_example=_without_zone(submodel(first).example(folder / first)),
            pip_requirements=requirements(bundle.submodels, root),
            mlflow_model=mlflow.models.Model(
                artifact_path=logged.artifact_location, run_id=run.run_id,
                model_uuid=logged.model_id, model_id=logged.model_id, metadata={"units": units},
            ),
        )  # fmt: skip
        client.log_model_artifacts(logged.model_id, str(Path(scratch) / "model"))
    client.finalize_logged_model(logged.model_id, LoggedModelStatus.READY)
    client.log_outputs(run.run_id, [LoggedModelOutput(logged.model_id, step=0)])
    return str(logged.model_id)


def _log_identifications(
    bundle: Bundle, folder: Path, root: Path, figures: Mapping[str, Mapping[str, float]]
) -> None:
    """A run of its own, below the bundle's, for each sub-model that no version has had so far."""
    import mlflow

    before = versions(bundle.machine, root)
    for name, one in bundle.submodels.items():
        if any(version.tags.get(f"{name}.sha256") == one.sha256 for version in before):
            continue
        with mlflow.start_run(run_name=f"{bundle.machine}-{name}-{one.sha256[:8]}", nested=True):
            mlflow.log_params(parameters_of(name, folder / name))
            mlflow.log_metrics(dict(figures[name]))
            files = training_files(name, folder / name)
            mlflow.log_text("".join(f"{sha256}  {file}\n" for file, sha256 in files),
                            "training_files.sha256")  # fmt: skip
            figure = scatter(folder / name)
            if figure:
                mlflow.log_text(figure, f"{name}.svg")
            mlflow.set_tags({
                "machine": bundle.machine, "origin": bundle.origin, "submodel": name,
                "model_sha256": one.sha256, "status": one.status,
                "training_sha256": hash_of_files(files),
            })  # fmt: skip


def _training_set(name: str, folder: Path, root: Path) -> Any:
    """Raw files that a sub-model was fitted on, as an MLflow data set with the hash over them."""
    from mlflow.entities import Dataset, DatasetInput, InputTag

    files = training_files(name, folder)
    uri = (root / "data/raw" / model_of_bundle(name, folder).machine).as_posix()
    return DatasetInput(
        Dataset(
            name=f"{name}, {len(files)} training files", digest=hash_of_files(files)[:DIGEST],
            source_type="local", source=json.dumps({"uri": uri}),
        ),
        [InputTag("mlflow.data.context", "training")],
    )  # fmt: skip


def _log_curves(bundle: Bundle, folder: Path, root: Path) -> None:
    """Training curves of every sub-model, a step an epoch."""
    import mlflow
    from mlflow.entities import Metric

    from pipeline.submodels.contract import submodel

    found = [
        Metric(f"{name}.curve.{plain(curve)}", value, 0, step)
        for name in bundle.submodels
        for curve, values in submodel(name).curves(folder / name).items()
        for step, value in enumerate(values, start=1)
    ]
    run = mlflow.active_run()
    if run is not None:
        for first in range(0, len(found), METRICS):
            client_of(root).log_batch(run.info.run_id, metrics=found[first : first + METRICS])


def _first(bundle: Bundle) -> str:
    """Sub-model that answers where none is named: the first that passed, else the first."""
    passed = (name for name, one in bundle.submodels.items() if one.status == "passed")
    return next(passed, next(iter(bundle.submodels)))


def _described(bundle: Bundle, folder: Path) -> tuple[Any, dict[str, dict[str, str]]]:
    """Signature of a bundle's pyfunc, all columns optional, and their units by sub-model."""
    from mlflow.models import ModelSignature
    from mlflow.types import ColSpec, ParamSchema, ParamSpec, Schema

    from pipeline.submodels.contract import submodel

    taken: dict[str, str] = {}
    given: dict[str, str] = {}
    units: dict[str, dict[str, str]] = {}
    for name in bundle.submodels:
        columns = read_json(folder / name / SERVED, Served)
        taken, given = {**columns.inputs, **taken}, {**columns.outputs, **given}
        verdict = read_json(folder / name / VERDICT, Verdict)
        units[name] = {score.quantity: score.unit for score in verdict.scores}
        units[name] |= {known.name: known.unit for known in submodel(name).inputs if known.unit}
    inputs, outputs = (
        Schema([ColSpec(kind, name, required=False) for name, kind in columns.items()])
        for columns in (taken, given)
    )
    parameters = ParamSchema([ParamSpec("submodel", "string", default=_first(bundle)),
                              ParamSpec("anyway", "boolean", default=False)])  # fmt: skip
    return ModelSignature(inputs=inputs, outputs=outputs, params=parameters), units


def _without_zone(table: "pd.DataFrame") -> "pd.DataFrame":
    """A table whose times are UTC without saying so: MLflow takes no others."""
    zoned = table.select_dtypes("datetimetz").columns
    return table.assign(**{name: table[name].dt.tz_convert(None) for name in zoned})


def model_card(bundle: Bundle, folder: Path, units: Mapping[str, Mapping[str, str]]) -> str:
    """Card of a bundle."""
    lines = [
        f"{HEAD} of {bundle.machine} ({bundle.origin} records)",
        "",
        f"Predicts what this one machine does; status: {bundle.status}. Not for another machine, "
        "and not for what no sub-model below was judged on.",
    ]
    if bundle.origin != "recorded":
        lines += ["", "Simulated: its records are of a simulated shop floor, not of a machine."]
    # a description is cut off at its end: what failed stands before what passed
    for name in sorted(
        bundle.submodels, key=lambda one: GRAVEST.index(bundle.submodels[one].status)
    ):
        lines += ["", *_part(name, folder / name, units.get(name, {}))]
    return "\n".join(lines) + "\n"


def as_description(card: str) -> str:
    """A card as MLflow's description: cut at a line where it is too long, and said so."""
    more = "\n\nThe whole card is model_card.md among the run's files.\n"
    if len(card) <= LONGEST:
        return card
    return card[: LONGEST - len(more)].rpartition("\n")[0] + more


def _part(name: str, folder: Path, units: Mapping[str, str]) -> list[str]:
    from pipeline.submodels.contract import submodel

    one = submodel(name)
    verdict, model = read_json(folder / VERDICT, Verdict), model_of_bundle(name, folder)
    inputs = ", ".join(f"{i.name} [{i.unit or 1}]" for i in one.inputs) or "see the signature"
    targets = ", ".join(dict.fromkeys(f"{s.quantity} [{s.unit}]" for s in verdict.scores))
    lines = [
        f"## {one.title[:1].upper()}{one.title[1:]} (`{name}`): {verdict.status}",
        "",
        f"- For: {targets or one.title}, from {inputs}.",
        f"- Learnt from: {_trained(model)}.",
        f"- Judged on: {_judged(verdict)}.",
    ]
    lines += [f"  - {_score(score, _limits(score, verdict))}" for score in _decisive(verdict)]
    lines += [f"- Limit: {reason}." for reason in verdict.missed[:MOST]]
    lines += [f"- Beyond what was learnt: {o.case}, {o.condition} {o.value} {o.unit}, learnt "
              f"{o.learnt}." for o in verdict.outside[:MOST]]  # fmt: skip
    unknown = [key for some in model.parameters.values() for key, p in some.items()
               if not p.determined]  # fmt: skip
    if unknown:
        lines.append(f"- Not determined by the records: {', '.join(unknown[:MOST])}.")
    others = ", ".join(f"{column} [{unit}]" for column, unit in sorted(units.items()) if unit)
    return [*lines, f"- Units: {others}."] if others else lines


def _trained(model: Model) -> str:
    cases = [one.case for one in model.trained_on]
    more = f" and {len(cases) - MOST} more" if len(cases) > MOST else ""
    return f"{', '.join(cases[:MOST])}{more}" if cases else "no case"


def _judged(verdict: Verdict) -> str:
    role = verdict.judged_role
    if role is None:
        return "nothing that it had not seen"
    count = len([case for case in verdict.cases if case.role == role])
    golden = verdict.golden
    frozen = f", frozen as {golden.sha256[:12]}" if golden and role == "golden" else ""
    return f"{count} cases of {ROLES.get(role, role)}{frozen}"


def _decisive(verdict: Verdict) -> list[Score]:
    """Scores over all groups that the verdict rests on; none where nothing was judged."""
    return [s for s in verdict.scores if s.group == "all" and s.role == verdict.judged_role and s.n]


def _limits(score: Score, verdict: Verdict) -> Mapping[str, float]:
    """Limits of a quantity and regime, which may be set for each group alone."""
    about = (score.quantity, score.regime, score.role)
    same = [s for s in verdict.scores if (s.quantity, s.regime, s.role) == about]
    return next((s.limits for s in [score, *same] if s.limits), {})


def _score(score: Score, bounds: Mapping[str, float]) -> str:
    regime = f", {score.regime}" if score.regime else ""
    errors = [
        f"{name.upper()} {value:.4g} {score.unit}".rstrip()
        for name in ("mae", "rmse", "max")
        if (value := getattr(score, name)) is not None
    ]
    limits = [f"{name} {limit:.4g}" for name, limit in bounds.items()]
    held = f" (limits: {', '.join(limits)})" if limits else ""
    inside = ""
    if score.coverage_90 is not None:
        inside = f"; {100 * score.coverage_90:.0f} % inside the 90 % interval"
    return f"{score.quantity}{regime}: {', '.join(errors)}{held}{inside}"


def scatter(folder: Path) -> str:
    """Measured against predicted by the first decisive score, as an SVG file; or empty."""
    if not (folder / PREDICTIONS).exists():
        return ""
    verdict = read_json(folder / VERDICT, Verdict)
    one = first_judged(verdict)
    points = shown_predictions(verdict, read_predictions(folder / PREDICTIONS))
    if one is None or points.empty:
        return ""
    title = f"{verdict.machine} {one.quantity} [{one.unit}], {one.role.replace('_', ' ')}"
    return str(_square(points, f"{title}, {verdict.origin}"))


def _square(points: "pd.DataFrame", title: str) -> str:
    """A square with one scale for both axes, its diagonal, and a dot a row."""
    both = points[["measured", "predicted"]]
    low, high = float(both.min().min()), float(both.max().max())
    step = (SIDE / (high - low)) if high > low else 0.0

    def place(value: float) -> float:
        return (value - low) * step

    whole = SIDE + 2 * MARGIN
    parts = [
        svg.tag("rect", width=whole, height=whole, fill="white"),
        svg.tag("line", x1=MARGIN, y1=MARGIN + SIDE, x2=MARGIN + SIDE, y2=MARGIN, stroke="gray"),
        svg.tag("text", title, x=MARGIN, y=MARGIN / 2, font_size=13),
        svg.tag("text", f"measured, {number(low)} to {number(high)}", x=MARGIN, font_size=12,
                y=whole - MARGIN / 2),
        svg.tag("text", "predicted, same scale", x=0, y=0, font_size=12,
                transform=f"translate({MARGIN / 2} {MARGIN + SIDE}) rotate(-90)"),
    ]  # fmt: skip
    for measured, predicted in both.itertuples(index=False):
        x, y = MARGIN + place(measured), MARGIN + SIDE - place(predicted)
        parts.append(svg.tag("circle", cx=x, cy=y, r=2, fill="#1f5fa8", fill_opacity=0.6))
    return str(svg.tag("svg", svg.group(parts), xmlns="http://www.w3.org/2000/svg",
                       width=whole, height=whole, role="img", aria_label=title))  # fmt: skip
