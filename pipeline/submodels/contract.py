"""Interface of a sub-model: its records, predictions, fit and stored model.

A sub-model is a folder of this room whose module ``submodel`` holds one object ``SUBMODEL``.  Its
stages ``identify_<name>`` and ``judge_<name>``, the registry and the report know no more of it.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Generic, TypeVar, get_type_hints

from pipeline.schema.arrays import Floats
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.model import Model, Parameter
from pipeline.schema.ranges import Range, Ranged
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Fact, Score, Verdict
from pipeline.submodels.cases import Case, Cases, Records, Roles

if TYPE_CHECKING:
    import pandas as pd

    from pipeline.charts.submodel_page import PageContent
    from pipeline.schema.arrays import Floats
    from pipeline.submodels.next_recording import Design

Fit = TypeVar("Fit")
Judging = TypeVar("Judging")
M = TypeVar("M", bound=Model)
S = TypeVar("S")


@dataclass(frozen=True, kw_only=True)
class Sections:
    """Sections of params.yaml that every sub-model reads: base of its own."""

    identity: MachineIdentity
    roles: Roles


@dataclass(frozen=True, kw_only=True)
class Input:
    """Input signal of a prediction, and the age of its measurements."""

    name: str
    unit: str
    """Name and unit of the signal."""
    older_than_s: float | None = None
    """A measurement that may be used when it is at least this old [s]; None for what is known
    before the motion: commands, programs, conditions."""


@dataclass(frozen=True, kw_only=True)
class Target:
    """A quantity that is predicted, and what its errors are held against."""

    quantity: str
    unit: str
    """Quantity and unit."""
    regime: str = ""
    """Regime of the prediction, such as a horizon; empty where there is one only."""
    limits: Mapping[str, float] = field(default_factory=dict)
    """Greatest value of an error, by its name in :class:`~pipeline.schema.verdict.Figures`. A
    target without limits and coverage is shown and decides nothing."""
    baselines: tuple[str, ...] = ()
    """Predictions that are made beside the model's, simpler or in hindsight."""
    titles: Mapping[str, str] = field(default_factory=dict)
    """Baselines in words, where their names are none."""
    must_beat: tuple[str, ...] = ()
    """Baselines that the model has to beat, on MAE and on RMSE both, over all groups."""
    each_group: bool = False
    """Whether it has to be so in every group."""
    resolution: float = 0.0
    """Step of the sensor [unit]; a shortfall that its rounding leaves open is "not decided"; 0
    where the column ``step`` of a prediction or the grid of its measured values tells it."""
    coverage: tuple[float, float] | None = None
    """Least and greatest share of samples inside the 90 % interval over all groups that decide [1],
    the greatest below 1, which an interval of any width keeps; None where none is stated."""
    most_percent: float = 0.0
    """Greatest RMSE over all groups that decide, over the RMS of what was measured [%]; 0 where
    there is no limit."""
    least_auc: float = 0.0
    """Least area under the ROC curve over all groups that decide, of a class of 0 or 1 [1]; 0 where
    there is no limit."""
    widens: bool = False
    """Whether the predictor widens its interval beyond training conditions; else the judge does."""
    widest: float = 2.5
    """Greatest half width of a 90 % interval over the RMSE with which it is said [1]; 1.64 is that
    of normal errors.  Beyond it the interval is "not known", and the prediction stands alone."""
    alone: int = 0
    """Groups that must keep their limits for a single one that does not to be named instead of
    deciding; 0 where each decides."""

    def unknown_interval(self, score: Score, trained: int) -> str:
        """Why the interval of a score over all groups is not known; empty where it is of use."""
        ratio = score.half_width_over_rmse
        if ratio is None or ratio <= self.widest:
            return ""
        return (
            f"90 % interval not known: {trained} training cases give one of {ratio:.2g} times the "
            f"RMSE, no use above {self.widest:g}; record more of them"
        )

    def __post_init__(self) -> None:
        if self.coverage is not None and not 0 <= self.coverage[0] < self.coverage[1] < 1:
            raise ValueError(
                f"coverage of {self.quantity} is {self.coverage}: give least and greatest share of "
                "samples, from 0 to below 1"
            )


@dataclass(frozen=True, kw_only=True)
class IntervalLimits(Ranged):
    """Limits of a sub-model that states 90 % intervals: base of its own."""

    coverage: tuple[Annotated[float, Range(least=0.0, below=1.0)], ...] = (0.8, 0.98)
    """Least and greatest share of samples inside the 90 % interval over all groups that decide [1].
    Of normal errors, 80 % lie inside an interval that is 0.78 times as wide as that of 90 %, and
    98 % inside one that is 1.41 times as wide."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.coverage) != 2 or self.coverage[0] >= self.coverage[1]:
            raise ValueError(
                f"{self.section}.coverage = {list(self.coverage)} must be the least and the "
                "greatest share"
            )

    @property
    def share(self) -> tuple[float, float]:
        """Least and greatest share, as a target has them [1]."""
        return self.coverage[0], self.coverage[1]


@dataclass(frozen=True, kw_only=True, eq=False)
class SeenInputs:
    """Inputs of a case beside what is learnt from them, T rows in the order of ``t``.

    NaN stands where a value is not known.  The judge probes them for the measurement itself.
    """

    quantity: str
    """Learnt quantity."""
    t: Floats
    measured: Floats
    """Time or use of the tool, and what was measured; shape (T,)."""
    inputs: Mapping[str, Floats]
    """Inputs by name, in each row as the model has them then; shape (T,) each."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction:
    """Prediction of one case."""

    frame: "pd.DataFrame"
    """Long: ``quantity``, ``unit``, ``regime``, ``t``, ``measured``, ``predicted`` and, where there
    are some, ``low``, ``high``, ``scored`` and ``baseline_<name>``."""
    facts: Mapping[str, Fact] = field(default_factory=dict)
    """Further facts of the case."""
    note: str = ""
    """Why it is not judged, where it is not; or what limits what can be compared."""
    cause: str = ""
    """Fault of the case's record that would explain its errors; "" where there is none."""
    seen: tuple[SeenInputs, ...] = ()
    """Inputs of what learns from measured ones; empty where all inputs are commands."""


Predictor = Callable[[Case], Prediction]
TEMPERATURE_RISE, VELOCITY, CUTTING_TIME = "temperature_rise", "velocity", "cutting_time"
"""Influences that causes of errors go with: rise of a temperature [K], velocity [unit of the
records], cutting time of the tool since it was changed [s]."""
Ends = Mapping[tuple[str, str], tuple[str, str]]
"""Columns with the low and the high end of an interval, by quantity and regime."""


class SubModel(ABC, Generic[Fit, Judging, M]):
    """Interface of a sub-model."""

    name: ClassVar[str]
    """Name of its folder, its lists in the fleet, its stages."""
    title: ClassVar[str]
    """Subject of the model in the words of the shop floor."""
    needs: ClassVar[str]
    """Required records, in a sentence."""
    reads: ClassVar[tuple[str, ...]]
    """Fields of :class:`~pipeline.submodels.cases.Records` in the order of the stages' commands."""
    model: ClassVar[type[Model]]
    """Type of ``model.json``."""
    fitting: ClassVar[type]
    judging: ClassVar[type]
    """Own :class:`Sections`, frozen dataclasses: what the fit reads, and what the judgement."""
    inputs: ClassVar[tuple[Input, ...]]
    """Signals that its predictions look at."""
    shared: ClassVar[str] = ""
    """Pattern of group and name of the parameters in which machines of a type are alike, so that
    they are pooled; empty for none."""
    unlike: ClassVar[str] = ""
    """Sentence on a machine of the same type whose :meth:`alike` differs, without its subject."""
    ends: ClassVar[Ends] = {}
    """Columns of :meth:`serve`'s answer with the ends of the 90 % interval.  Where a quantity is of
    each axis, its letter follows the name there, and stands before the columns."""

    @abstractmethod
    def targets(self, settings: Judging, model: M) -> tuple[Target, ...]:
        """Predicted quantities, with the limits of the settings."""

    @abstractmethod
    def cases(self, records: Records, settings: "Fit | Judging", sets: Any = None) -> Cases:
        """Cases in the records of a machine; ``sets`` are the frozen ones, None during a fit."""

    @abstractmethod
    def fit(self, cases: Cases, settings: Fit, folder: Path) -> M:
        """The model of the training cases; further files go into ``folder``."""

    @abstractmethod
    def load(self, folder: Path, settings: Judging) -> Predictor:
        """The predictor of a stored model, for cases."""

    @abstractmethod
    def serve(self, folder: Path) -> "Callable[[pd.DataFrame], pd.DataFrame]":
        """The predictor of a stored model, for a table of its inputs: what the registry serves."""

    @abstractmethod
    def example(self, folder: Path) -> "pd.DataFrame":
        """A small table that :meth:`serve`'s predictor takes."""

    def answer(self, folder: Path) -> "Callable[[pd.DataFrame], pd.DataFrame]":
        """:meth:`serve`'s predictor, with NaN for the ends of intervals that are not known.

        It raises ValueError for a table without a row, where a column of numbers or times holds
        something else, and where one of texts lacks one.
        """
        predict, blank = self.serve(folder), set(self.unknown_columns(folder))
        columns = self.example(folder)

        def answered(table: "pd.DataFrame") -> "pd.DataFrame":
            if not len(table):
                raise ValueError("the table has no row: give a row of inputs")
            for name in columns.columns.intersection(table.columns):
                kind = columns[name].dtype.kind
                _check_column(table[name], {"M": "time", "O": "text"}.get(kind, "number"))
            found = predict(table)
            return found.assign(**{name: float("nan") for name in found if name in blank})

        return answered

    def unknown_columns(self, folder: Path) -> dict[str, str]:
        """Columns of :meth:`answer` that are not known by the verdict, with the reason."""
        found: dict[str, str] = {}
        for (quantity, regime), why in unknown_intervals(folder).items():
            name, _, letter = quantity.rpartition(" ")
            own = self.ends.get((quantity, regime), ())
            of_axis = self.ends.get((name, regime), ())
            found |= dict.fromkeys((*own, *(f"{letter}_{end}" for end in of_axis)), why)
        return found

    def curves(self, folder: Path) -> Mapping[str, Sequence[float]]:
        """Error after each epoch of what was trained, by a name; none where nothing is trained."""
        return {}

    def figures(self, model: M) -> Mapping[str, Any]:
        """Further key figures for the metrics, by their names; none by default."""
        return {}

    def alike(self, model: M) -> tuple[Any, ...]:
        """Values that machines must share beside their type for parameters to be pooled."""
        return ()

    def designs(self, model: M, cases: Cases, settings: Judging) -> "Sequence[Design]":
        """Recordings that could be made, by what they would tell of the parameters.

        None by default: :mod:`~pipeline.submodels.next_recording` goes by remedies and conditions.
        """
        return ()

    def influences(self, case: Case, rows: "pd.DataFrame") -> "Mapping[str, Floats]":
        """Influences beside ``rows`` of a quantity of a case's prediction, (T,) each, by name."""
        return {}

    def page(self, shown: "Shown[M]") -> "PageContent | None":
        """Page content that only this sub-model has: ``content`` of the ``page.py`` in its folder.

        None without one; the sub-model's files give the rest of its page.
        """
        if not (Path(__file__).parent / self.name / "page.py").exists():
            return None
        page: PageContent = import_module(f"pipeline.submodels.{self.name}.page").content(shown)
        return page


@dataclass(frozen=True, kw_only=True, eq=False)
class Shown(Generic[M]):
    """Content of a sub-model's page; None where a file is missing."""

    machine: str
    origin: str
    model: M | None
    verdict: Verdict | None
    predictions: "pd.DataFrame | None"
    truth: Mapping[str, Any] | None = None
    """Truth of a simulated machine."""
    shelf: Any = None
    """Reader of further files, so that the page can name its sources."""
    folder: Path = Path()
    """Folder of the sub-model's files."""
    clean: Path | None = None
    signals: Path | None = None
    """Folders of the machine's clean records and of its signals."""

    def parameters(self, group: str = "") -> Mapping[str, Parameter]:
        """Parameters of a group by name; none without a model."""
        return {} if self.model is None else self.model.parameters.get(group, {})


def unknown_intervals(folder: Path) -> Mapping[tuple[str, str], str]:
    """Why intervals of the sub-model in ``folder`` are not known, by quantity and regime."""
    path = folder / "verdict.json"
    return read_json(path, Verdict).unknown_intervals if path.exists() else {}


def _check_column(column: "pd.Series[Any]", kind: str) -> None:
    """Refuse a column with something else than its kind; numbers and times may be missing."""
    import pandas as pd

    if kind == "text":
        wrong = ~column.map(lambda value: isinstance(value, str)).to_numpy(bool)
    else:
        times = partial(pd.to_datetime, utc=True, format="ISO8601")
        read: Any = pd.to_numeric if kind == "number" else times
        wrong = (read(column, errors="coerce").isna() & column.notna()).to_numpy()
    if wrong.any():
        row = int(wrong.argmax())
        raise ValueError(
            f"{column.name} is {column.iloc[row]!r} in row {row + 1}, which is no {kind}: give one"
        )


def submodels() -> list[str]:
    """Names of all sub-models, in the order of the alphabet."""
    return sorted(p.parent.name for p in Path(__file__).parent.glob("*/submodel.py"))


def submodel(name: str) -> SubModel[Any, Any, Any]:
    """The sub-model ``name``; ValueError when there is none of that name."""
    if name not in submodels():
        raise ValueError(f"there is no sub-model {name!r}; there are {', '.join(submodels())}")
    return import_module(f"pipeline.submodels.{name}.submodel").SUBMODEL


def judging_of(
    one: SubModel[Any, Judging, Any], values: Mapping[str, Any], machine: str
) -> Judging:
    """Settings by which a sub-model of a machine is judged, out of those of the project."""
    return settings_of(one.judging, values, machine)


def settings_of(kind: type[S], values: Mapping[str, Any], machine: str) -> S:
    """Settings of a machine's sub-model, of the type ``kind``, out of those of the project."""
    from pipeline.parameters import section_path, structure

    return kind(**{
        section: structure(dict(values), section_path(dict(values), section, machine), wanted)
        for section, wanted in sections(kind).items()
    })  # fmt: skip


def sections(settings: type) -> dict[str, Any]:
    """Sections of params.yaml that a settings type is made of, with their types."""
    hints = get_type_hints(settings, include_extras=True)
    return {item.name: hints[item.name] for item in fields(settings)}
