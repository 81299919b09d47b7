"""Stored optimised part program, and its trial cuts on the simulated shop floor.

Times are in [s], lengths in [mm], loads in [N], shares in [1]; F as the program writes it, S in
[rev/min].  A value that is not known is None.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from pipeline.schema.drive import AxisInCut
from pipeline.schema.limits import CutLimit
from pipeline.schema.part_sheet import (
    FeedChange,
    FeedUnit,
    PathTrace,
    ProgramLine,
    SetupSheet,
    ToolUse,
)
from pipeline.schema.program_cut import CutWarning, NotKnown, ToolEdge
from pipeline.schema.store import unstructured
from pipeline.schema.verdict import UsedModel

Objective = Literal["time", "cost", "energy", "wear", "pareto"]
"""Quantity to be minimised; ``pareto`` takes the knee of the front of all that are known."""
MethodLimits = Literal["nominal", "certain"]
"""Load limit at nominal values, or with the probability that is allowed."""
Side = Literal["before", "after"]
"""The program as it was, and as it is optimised."""


@dataclass(frozen=True, kw_only=True)
class Totals:
    """Sums and peaks of a whole program."""

    time_s: float | None = None
    """Time [s]."""
    cost: float | None = None
    cost_low: float | None = None
    cost_high: float | None = None
    """Cost in the currency of the document, and its ends by the tools' lives, None without."""
    energy_kWh: float | None = None
    """Energy [kWh]."""
    tool_life_share: float | None = None
    tool_life_share_low: float | None = None
    tool_life_share_high: float | None = None
    """Share of tool lives used, summed over tools, and at the ends of their spread [1]."""
    peak_load_N: float | None = None
    """Highest load across the tool's axis, predicted [N]."""
    peak_line: int | None = None
    """Line of the program where it is."""
    beyond: int | None = None
    """Blocks that pass a limit."""
    beyond_of: Mapping[str, int] = field(default_factory=dict)
    """Number of blocks beyond each limit, by its name; limits that no block passes are left out."""


@dataclass(frozen=True, kw_only=True)
class Gain:
    """Change of each total from before to after [%]; negative is less."""

    time_percent: float | None = None
    cost_percent: float | None = None
    energy_percent: float | None = None
    tool_life_percent: float | None = None


@dataclass(frozen=True, kw_only=True)
class PeakQuantile:
    """Load [N] that the part's peak stays below in a ``share`` of parts [1]."""

    share: float
    load_N: float | None


@dataclass(frozen=True, kw_only=True)
class Nominal:
    """Blockwise optimum at nominal values: time [s] and cost [currency]."""

    time_s: float | None
    cost: float | None


@dataclass(frozen=True, kw_only=True)
class Price:
    """Extra time [s, %] and cost [currency, %] of keeping the load limit with its probability."""

    time_s: float | None
    time_percent: float | None
    cost: float | None
    cost_percent: float | None


@dataclass(frozen=True, kw_only=True)
class UncertainQuantity:
    """One uncertain quantity in words: what it is, its value, its spread, its source."""

    what: str
    value: str
    spread: str
    source: str


@dataclass(frozen=True, kw_only=True)
class Reliability:
    """Probability that the load passes its limit, as it was allowed and as it is."""

    epsilon: float
    """Allowed for the whole part [1]."""
    exceedance: float | None
    """Exceedance probability in held-out draws [1]."""
    interval_95: tuple[float | None, ...]
    """95 % interval of the exceedance [1]."""
    draws: int
    """Draws of the uncertain quantities."""
    peaks: tuple[PeakQuantile, ...]
    """Peaks of the part's peak load."""
    nominal: Nominal | None
    price: Price | None
    """Optimum at nominal values, and the extra over it."""
    uncertain: tuple[UncertainQuantity, ...]
    """Quantities that are drawn."""
    limits_N: str = ""
    """Limits of the load in words: of the part, and of tools with their own."""
    without: tuple[int, ...] = ()
    """Tools that it does not hold for: those that cannot keep their limit, and thread mills."""

    @property
    def of_tools(self) -> str:
        """Tools that it leaves out, as the end of a sentence; empty where none."""
        named = ", ".join(f"T{number}" for number in self.without)
        return f", without {named}" if named else ""


@dataclass(frozen=True, kw_only=True)
class MethodResult:
    """Objectives of one method under one kind of limits, and its evaluations.

    Units as in :class:`Totals`.  ``limits``: load limit at nominal values or with its probability;
    ``feasible``: all those limits kept with their margins.
    """

    method: str
    limits: MethodLimits
    time_s: float | None
    cost: float | None
    energy_kWh: float | None
    tool_life_share: float | None
    feasible: bool
    evaluations: int


@dataclass(frozen=True, kw_only=True)
class FrontMember:
    """Member of the Pareto front; units as in :class:`Totals`.

    ``knee``: best trade-off; ``no_worse``: in nothing worse than the program as it was.
    """

    time_s: float | None
    cost: float | None
    energy_kWh: float | None
    tool_life_share: float | None
    knee: bool = False
    no_worse: bool = False


@dataclass(frozen=True, kw_only=True)
class BlockGroup:
    """Blocks in a row of one F and one S, before and after."""

    first_line: int
    last_line: int
    """First and last line of the program."""
    tool: int
    """Number of the tool."""
    feed_before: float | None
    feed_after: float | None
    feed_unit: FeedUnit
    """F, its mean over time, before and after, and its unit."""
    speed_before: float | None
    speed_after: float | None
    """S, its mean over time [rev/min]."""
    time_before_s: float | None
    time_after_s: float | None
    cost_before: float | None
    cost_after: float | None
    """Time [s] and cost [currency] before and after."""
    peak_load_before_N: float | None
    peak_load_after_N: float | None
    """Peak load before and after [N]."""
    binds: str | None
    """Limit that binds for the longest; None where none does."""
    kept: str | None = None
    """Reason why F and S of all of them stay as programmed; None where one may change."""


@dataclass(frozen=True, kw_only=True)
class Binding:
    """Blocks of one limit (None: of no limit, or ``kept`` for a reason), and their time [s]."""

    limit: str | None
    blocks: int
    time_s: float | None
    kept: str | None = None


@dataclass(frozen=True, kw_only=True)
class HeldRows:
    """Moves that stay as programmed: why, how many, the first of them as ``file:line``."""

    reason: str
    rows: int
    first: str


@dataclass(frozen=True, kw_only=True)
class WordCounts:
    """F and S words that were changed and added."""

    F_changed: int
    F_added: int
    S_changed: int
    S_added: int

    @property
    def total(self) -> int:
        """All words that differ."""
        return self.F_changed + self.F_added + self.S_changed + self.S_added


@dataclass(frozen=True, kw_only=True)
class StoredProof:
    """Proof that nothing but F and S words differs."""

    same: bool
    """Whether the proof holds."""
    sha256: str
    """Hash of everything that both programs do but F and S."""
    moves: int
    """Number of compared moves."""
    before_sha256: str
    after_sha256: str
    """Hashes of the two texts."""
    first: str | None
    """First difference."""
    points: int = 0
    """Lines that were put in on the path of straight cuts."""


@dataclass(frozen=True, kw_only=True)
class LoadTrace:
    """Highest load in each of N columns of equal path length at feed."""

    total_mm: float
    """Path length at feed [mm]."""
    way_mm: tuple[float, ...]
    """Path length where each column begins [mm]."""
    load_N: tuple[float | None, ...]
    """Load [N]; None in air."""
    line: tuple[int, ...]
    """Line of the program, where each column begins."""


@dataclass(frozen=True, kw_only=True)
class Traces:
    """Load along the path before and after, by equal columns of the path.

    ``tools`` holds number, begin and end of each stretch of one tool, as shares of the path.
    """

    before: LoadTrace
    after: LoadTrace
    tools: tuple[tuple[int, float, float], ...]


@dataclass(frozen=True, kw_only=True)
class TwinCheck:
    """The answer as the whole twin sees it."""

    peak_load_N: float | None
    """Highest load, of the waveform [N]."""
    peak_line: int | None
    """Line of the program where it is."""
    following_um: Mapping[str, float | None] | None
    """Greatest following error by axis in the cut [um]; None without drives."""
    full_evaluations: int
    """Full evaluations of the whole twin."""
    tightened: int
    """Rounds in which feeds were lowered for it."""
    axes: tuple[AxisInCut, ...] = ()
    """Following error and motor command of each axis in the cut; empty where not known."""


@dataclass(frozen=True, kw_only=True)
class OptimisedPart:
    """A part program before and after."""

    warnings: tuple[CutWarning, ...] = ()
    """Grave warnings, and tools and registers that do not fit the program; all others are in
    ``setup``."""
    verdicts: tuple[UsedModel, ...] = ()
    """Verdicts on the sub-models of its figures; failed or unjudged ones first."""
    program: str
    machine: str
    """Names."""
    origin: str
    """Origin of the machine's records."""
    control: str
    """Origin of the control: ``identified``, or ``conf/machine`` as written there."""
    objective: Objective
    """Objective that was minimised."""
    currency: str | None
    """Currency of all costs; None where prices are not known."""
    stock: str
    material: str
    tool_table: str
    """Blank [mm], material, tools."""
    limits: CutLimit
    """Limits of the part; stored without those that do not hold."""
    certainty: Reliability | None
    """Certainty of the load limit; None without one."""
    before: Totals
    after: Totals
    """Totals of the program as it was and as it is optimised."""
    gain: Gain
    """Gain from before to after."""
    methods: tuple[MethodResult, ...]
    """The answer beside others."""
    front: tuple[FrontMember, ...]
    """Front of the objective ``pareto``."""
    groups: tuple[BlockGroup, ...]
    """Groups in the order of the program."""
    binding: tuple[Binding, ...]
    """Limits of blocks that cut, the longest first."""
    held: tuple[HeldRows, ...]
    """Moves whose F or S may not change."""
    words: WordCounts
    """F and S words that differ."""
    proof: StoredProof
    """Proof that only these words differ."""
    trace: Traces
    """Load along the path."""
    verified: TwinCheck
    """Check by the whole twin."""
    interrupted: bool
    """Whether the search was ended early."""
    not_known: tuple[NotKnown, ...]
    """Quantities that the document lacks."""
    notes: tuple[str, ...]
    """Notes on the figures, one sentence each."""
    tools: tuple[ToolUse, ...]
    """Tools that cut, in the order of the program."""
    changes: tuple[FeedChange, ...]
    """Runs of blocks whose F or S changed, in the order of the program."""
    lines: tuple[ProgramLine, ...]
    """Lines of the program whose F or S words changed, with those next to them."""
    path: PathTrace | None
    """Path of the tool's tip at feed."""
    setup: SetupSheet
    """Setup of the machine for this part."""
    unit: Literal["mm", "inch"] = "mm"
    """Unit of length in which the program writes its feeds."""
    residual: str | None = None
    """residual network whose residual and interval following errors hold; stored only where
    there is one."""
    machine_unit: str | None = None
    """Unit among several machines of a kind; stored only where there are several."""
    edges: tuple[ToolEdge, ...] = ()
    """Wear of each tool that figures and limits hold for, with the force of the optimised program
    sharp and worn."""
    split: str | None = None
    """Gain of splitting long blocks, in words; stored only where it was requested."""

    @property
    def load_limit_N(self) -> float | None:
        """Load limit that all tools have [N]; None without one, or where they differ."""
        own = any("load_N" in use.limits for use in self.tools)
        return None if own else self.limits.load_N

    def totals(self, side: Side) -> Totals:
        """Totals before or after."""
        return self.before if side == "before" else self.after


def part_values(part: OptimisedPart) -> dict[str, Any]:
    """A part as it is stored, without limits that do not hold and names that are none."""
    values: dict[str, Any] = unstructured(part)
    for name in ("residual", "machine_unit", "split"):
        if values[name] is None:
            del values[name]
    given = part.limits.given
    values["limits"] = {name: one for name, one in values["limits"].items() if name in given}
    return values


@dataclass(frozen=True, kw_only=True)
class Spread:
    """Mean and greatest of a quantity over trial cuts; ``min`` where it is stored."""

    mean: float
    max: float
    min: float | None = None


@dataclass(frozen=True, kw_only=True)
class TrialSide:
    """Trial cuts of one program: time [s], peak load [N], cuts with a load above the limit."""

    time_s: Spread
    peak_load_N: Spread
    above: int
    peak_line: int | None = None


@dataclass(frozen=True, kw_only=True)
class TrialPart:
    """Trial cuts of a part: ``seeds`` of each program, and the load limit [N]."""

    seeds: int
    before: TrialSide
    after: TrialSide
    limit_load_N: float | None = None

    def side(self, which: Side) -> TrialSide:
        """Cuts of the program before or after."""
        return self.before if which == "before" else self.after


@dataclass(frozen=True, kw_only=True)
class TrialCuts:
    """Parts that the simulated shop floor cut, by label."""

    parts: Mapping[str, TrialPart]
    machine: str = ""
    origin: str = "simulated"
