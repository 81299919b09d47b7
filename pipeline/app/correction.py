"""The corrected command that ``kerf simulate --compensate`` writes."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pipeline.app.programs import Simulated, needed_drives
from pipeline.parameters import structure
from pipeline.schema.bundle import BUNDLE, Bundle, bundle_words, read_champions
from pipeline.schema.store import read_json
from pipeline.submodels.compensation.model import residual_of
from pipeline.twin.correction import (
    CorrectedProgram,
    CorrectionSettings,
    corrected_program,
    correction_table,
)
from pipeline.twin.drive import read_drives


def correct_simulated(simulated: Simulated, program: Path) -> CorrectedProgram:
    """Corrected command of a program's axes on a machine."""
    on, plan = simulated.on, simulated.plan
    found = needed_drives(on, "--compensate")
    residual, words = residual_of(on.models)
    axes, cutting = corrected_program(
        plan, read_drives(found), residual,
        settings=structure(on.parameters, "correction", CorrectionSettings),
    )  # fmt: skip
    return CorrectedProgram(
        machine=on.machine, origin=on.origin, program=program.stem,
        champion=_champion(on.models, on.machine), residual=words, total=plan.total, axes=axes,
        cutting=cutting,
    )  # fmt: skip


def _champion(models: Path, machine: str) -> str:
    """The bundle in ``models``, and the version that champions.json says it is."""
    entry = read_champions(Path("champions.json")).machines.get(machine)
    stored = models / BUNDLE
    if entry is None or not stored.exists() or read_json(stored, Bundle).sha256 != entry.bundle:
        return bundle_words(models)
    return f"version {entry.version}, {bundle_words(models)}"


def correction_lines(document: dict[str, Any]) -> Iterator[str]:
    """Following error as predicted, before and after correction, in lines of ``kerf simulate``."""
    yield f"corrected command in {document['file']}, residual network: {document['residual']}"
    yield "following error as predicted:"
    yield from (f"  {line}" for line in correction_table(document["axes"]))
    most = max(one["max_after_um"] for one in document["axes"])
    yield (
        f"rapids are commanded as planned: there an axis stays behind by up to {most:.0f} um; the "
        "correction fades out after a cut and in before the next, for all axes alike"
    )
