"""Facts about the cut: coefficients of the force model, how well it predicts forces, traces."""

from dataclasses import dataclass, field
from typing import Any, Literal

from pipeline.charts.numbers import real
from pipeline.charts.sources import Shelf, dig, objects_of, rows_of, words_of
from pipeline.report.cutting_traces import JUDGED, CutTrace, cut_traces
from pipeline.report.cutting_units import determined
from pipeline.report.folders import MachineFolders

RECORDS = "recordings of forces and of the spindle’s load"
COMPONENTS = ("x", "y", "z", "resultant")  # the last is the force in the plane of the feed
ERRORS = ("rms", "peak", "mean")
Of = Literal["model", "mechanics", "plain"]
ALIKE = 1e-3  # of an error; two predictions closer than that are equally good


@dataclass(frozen=True, kw_only=True)
class CutRun:
    """One recording held against the force model.

    Parameters
    ----------
    recording, role, reason : str
        Which, ``judged`` or ``training``, why it failed or was not judged.
    conditions : dict
        Speed, feed, depth, as the document has them.
    components, mechanics, plain : dict of str to dict
        Measured, modelled and errors by component; the same of mechanics alone, and of the plain
        guess.
    plain_what : str
        What the plain guess is, in words.
    fitted_on : list of str
        Recordings of the fit that predicts it, where it is not the model's own.
    status : {"passed", "failed", "unknown"}
        ``unknown`` where it does not count.
    """

    recording: str
    role: str
    reason: str
    conditions: dict[str, Any]
    components: dict[str, dict[str, Any]]
    mechanics: dict[str, dict[str, Any]]
    plain: dict[str, dict[str, Any]]
    plain_what: str
    fitted_on: list[str]
    status: Literal["passed", "failed", "unknown"]

    @property
    def learnt(self) -> bool:
        """Whether the fit that predicts it has seen it."""
        return self.role == "training" and self.status == "unknown" and not self.fitted_on

    def error(self, kind: str, component: str, of: Of = "model") -> float | None:
        """Error [%] of one component with its sign; None where not known."""
        rows = {"model": self.components, "mechanics": self.mechanics, "plain": self.plain}[of]
        return real(dig(rows, component, f"{kind}_error_percent"))

    @property
    def whole(self) -> str:
        """The component that is judged: the resultant, else the one whose RMS errs most."""
        known = {c: abs(e) for c in self.components if (e := self.error("rms", c)) is not None}
        return (
            "resultant" if "resultant" in known else max(known, key=known.__getitem__, default="")
        )

    def size(self, kind: str, of: Of = "model") -> float | None:
        """Size of an error [%] of what is judged."""
        found = self.error(kind, self.whole, of)
        return None if found is None else abs(found)

    def plain_better(self, kind: str = "rms") -> bool:
        """Whether the plain guess comes closer than the model."""
        model, plain = self.size(kind), self.size(kind, "plain")
        return model is not None and plain is not None and plain < model * (1 - ALIKE)


@dataclass(frozen=True, kw_only=True)
class Cutting:
    """What is known of the cut; None where the file that would say it is absent."""

    document: dict[str, Any] | None = None
    validation: dict[str, Any] | None = None
    traces: list[CutTrace] = field(default_factory=list)

    @property
    def parameters(self) -> dict[str, dict[str, Any]]:
        """What was found, by name."""
        return objects_of(self.document, "parameters")

    @property
    def undetermined(self) -> list[str]:
        """Names of the parameters that the records do not determine."""
        return [name for name, p in self.parameters.items() if not determined(p)]

    @property
    def runs(self) -> list[CutRun]:
        """Every recording with the model's own parameters: the judged first, then by name."""
        runs = [_run(row) for row in rows_of(self.validation, "recordings")]
        return sorted(runs, key=lambda r: (r.status == "unknown", r.recording))

    @property
    def cross(self) -> list[CutRun]:
        """Every recording predicted by a fit on others."""
        return [_run(row) for row in rows_of(self.validation, "cross")]

    @property
    def judged(self) -> list[CutRun]:
        """Those that count: nothing was learnt from them, and they could be judged."""
        return [r for r in self.runs if r.status != "unknown"]

    @property
    def telling(self) -> list[CutRun]:
        """Predictions of what was not learnt from: the judged, or the cross ones without any."""
        return self.judged or [r for r in self.cross if r.size("rms") is not None]

    def limit(self, kind: str) -> float | None:
        """Largest error that passes [%]; ``kind`` of :data:`ERRORS`."""
        return real(dig(self.validation, "limits", f"{kind}_percent"))

    def trace(self, recording: str) -> CutTrace | None:
        """The trace of a recording."""
        return next((t for t in self.traces if t.recording == recording), None)


def worst_run(runs: list[CutRun], kind: str = "rms") -> CutRun | None:
    """The run that is predicted worst; None without any."""
    known = [r for r in runs if r.size(kind) is not None]
    return max(known, key=lambda r: r.size(kind) or 0.0, default=None)


def best_run(runs: list[CutRun]) -> CutRun | None:
    """The run that is predicted best; None without any."""
    known = [r for r in runs if r.size("rms") is not None]
    return min(known, key=lambda r: r.size("rms") or 0.0, default=None)


def _run(row: dict[str, Any]) -> CutRun:
    status, conditions = row.get("status"), row.get("conditions")
    return CutRun(
        recording=str(row.get("recording") or ""),
        role=str(row.get("role") or ""),
        reason=str(row.get("reason") or ""),
        conditions=conditions if isinstance(conditions, dict) else {},
        components=_components(row.get("components")),
        mechanics=_components(dig(row, "mechanics", "components")),
        plain=_components(dig(row, "plain", "components")),
        plain_what=str(dig(row, "plain", "what") or ""),
        fitted_on=words_of(row, "from"),
        status=status if status in ("passed", "failed") else "unknown",
    )


def _components(found: Any) -> dict[str, dict[str, Any]]:
    known = objects_of({"components": found}, "components")
    return {name: known[name] for name in COMPONENTS if name in known}


def cutting_facts(folders: MachineFolders, shelf: Shelf) -> Cutting:
    """What the files of the cut and of its judgement say."""
    return Cutting(
        document=shelf.document(folders.models / "cutting.json", RECORDS),
        validation=shelf.document(folders.models / "cutting_validation.json", JUDGED),
        traces=cut_traces(folders, shelf),
    )
