"""Synthetic windows at a wear and conditions, or the wear of recorded ones (`kerf synthesise`)."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from pipeline.app.fleet import machine_parameters
from pipeline.app.output import check_outputs, label
from pipeline.app.programs import passed_status, stored_model
from pipeline.schema.store import write_json
from pipeline.submodels.synthesis.model import WEAR, Synthesis, load_synthesis
from pipeline.submodels.synthesis.samples import (
    conditions_of_words,
    explanation,
    generated,
    read_windows,
    write_generated,
)
from pipeline.submodels.synthesis.submodel import SUBMODEL


def served_of(machine: str, model: str, *, anyway: bool) -> Synthesis:
    """The generator of a machine; refused where it did not pass, unless ``anyway``."""
    machine_parameters(machine)  # refuses one that is not known
    folder = stored_model(machine, model, SUBMODEL)
    passed_status(folder, "generator", anyway=anyway)
    return load_synthesis(folder)


def pairs(texts: Sequence[str]) -> dict[str, str]:
    """Names and values of ``name=value``."""
    found: dict[str, str] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise ValueError(f"--set {text!r} is not name=value: name a condition and its value")
        if name in found:
            raise ValueError(f"--set {name} is given twice: give it once")
        found[name] = value
    return found


def made_windows(
    served: Synthesis, words: Mapping[str, str], many: int, seed: int, out: Path
) -> Iterator[str]:
    """Write windows at conditions; lines on them."""
    check_outputs(None, out)
    made = generated(served, conditions_of_words(served, words), many, seed)
    rows, file = write_generated(made, out), served.file
    conditions = ", ".join(
        f"{name} {_words(one['value'])} {one['unit']}".rstrip()
        for name, one in made.head["conditions"].items()
    )
    head = f"{file.machine}{label(file.origin)}"
    yield f"{head}: {len(made.values)} synthetic windows at {conditions}"
    yield f"wrote {rows} rows to {out}"


def _words(value: float | str) -> str:
    return (value or "not given") if isinstance(value, str) else f"{value:g}"


def explained_wear(
    served: Synthesis, recording: Path, words: Mapping[str, str], out: Path | None
) -> Iterator[str]:
    """Lines on the wear that explains a recording best; its profile as JSON where one is named."""
    check_outputs(None, out, inputs=[recording])
    given = conditions_of_words(served, {k: v for k, v in words.items() if k != WEAR})
    found, file = explanation(served, read_windows(recording, served), given), served.file
    if out is not None:
        write_json({**found.document, "machine": file.machine, "trained_on": file.origin}, out)
    low, high = found.as_good
    yield (
        f"{file.machine}{label(file.origin)}: wear {found.best:.3g} {found.unit} explains it best; "
        f"{low:.3g} to {high:.3g} {found.unit} do about as well"
    )
    yield f"{'wear':>8}  {'distance':>9}"
    for wear, distance in zip(found.wear, found.distance, strict=True):
        yield f"{wear:>8.4g}  {distance:>9.4g}"
