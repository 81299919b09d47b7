"""What an optimisation aims at, what limits it, how sure it has to be, and how it searches."""

from dataclasses import dataclass, field, fields
from typing import Literal

Objective = Literal["time", "cost", "energy", "wear", "pareto"]
OBJECTIVES: tuple[Objective, ...] = ("time", "cost", "energy", "wear")
"""In the order of every array that has one column for each."""
UNITS = {"time": "s", "cost": "", "energy": "kWh", "wear": "1"}

Range = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Margins:
    """What is kept free of each limit, as a share of it [1].

    A limit L counts as L (1 - margin) where values must stay below it, and as L (1 + margin) where
    they must stay above it.
    """

    load: float = 0.0
    power: float = 0.05
    torque: float = 0.05
    chip: float = 0.0
    deflection: float = 0.05
    stability: float = 0.1
    cutting_speed: float = 0.0
    roughness: float = 0.05

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not 0.0 <= value < 1.0:
                raise ValueError(f"margins.{item.name} = {value} is out of its range, 0 to below 1")


@dataclass(frozen=True, kw_only=True)
class CutLimit:
    """Limits of a part's cut, in the units of tables; what is None is not limited.

    Parameters
    ----------
    load_N : float, optional
        Peak of the load across the tool's axis [N].
    deflection_um : float, optional
        Of the tool's tip [um].
    roughness_um : float, optional
        Height of the feed marks on walls and floors, R_t [um].
    chip_um : tuple of float, optional
        Least and greatest thickness of the thickest chip of a block [um].
    cutting_speed_m_min : tuple of float, optional
        Least and greatest v_c [m/min].
    feed_mm_min : tuple of float, optional
        F [mm/min]; by default from a tenth of the program's least up to what the axes can.
    speed_rpm : tuple of float, optional
        S [rev/min]; by default what the spindle's drive has.
    torque_Nm : float, optional
        Of the cut, beside the drive's own [N m].
    power_share : float
        Of the drive's power at each speed [1].
    least_speed_change_rpm : float
        Between two blocks of one tool S stays or changes by at least this [rev/min].
    margins : Margins
        What is kept free of each.

    Raises
    ------
    ValueError
        When a limit is not positive, or a range is none.
    """

    load_N: float | None = None
    deflection_um: float | None = None
    roughness_um: float | None = None
    chip_um: tuple[float, ...] | None = None
    cutting_speed_m_min: tuple[float, ...] | None = None
    feed_mm_min: tuple[float, ...] | None = None
    speed_rpm: tuple[float, ...] | None = None
    torque_Nm: float | None = None
    power_share: float = 1.0
    least_speed_change_rpm: float = 0.0
    margins: Margins = field(default_factory=Margins)

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if value is None or isinstance(value, Margins):
                continue
            if isinstance(value, tuple):
                if not (len(value) == 2 and 0.0 <= value[0] <= value[1] < 1e12 and value[1] > 0):
                    raise ValueError(
                        f"limits.{item.name} = {list(value)} must be two numbers, the least first"
                    )
            elif not (0.0 <= value < 1e12 and (value > 0 or item.name[:5] == "least")):
                raise ValueError(f"limits.{item.name} = {value:g} must be positive and finite")


@dataclass(frozen=True, kw_only=True)
class Certainty:
    """How sure the answer has to be of its load limit, and what is not known well.

    Parameters
    ----------
    epsilon : float
        P(load > limit) over a whole part is at most this [1]; 0.5 and above takes nominal values.
    draws : int
        Of what is uncertain.
    seed : int
        Of all chance.
    measured_elsewhere, catalogue : float
        Standard deviation of coefficients that come from others' measurements, or a catalogue, as
        a share of them [1]; identified ones have their own intervals.
    runout_um : float
        Of a tool in its holder, where the tool table says none: Rayleigh's scale [um].
    depth_um : float
        Standard deviation of axial depth: tool length, blank [um].
    model : float
        Standard deviation of the model's peak loads, as a share [1]; where recordings that the
        coefficients were not found from were judged, theirs counts if it is greater.

    Raises
    ------
    ValueError
        When a value is out of its range.
    """

    epsilon: float = 0.01
    draws: int = 1024
    seed: int = 0
    measured_elsewhere: float = 0.1
    catalogue: float = 0.25
    runout_um: float = 3.0
    depth_um: float = 10.0
    model: float = 0.02

    def __post_init__(self) -> None:
        for name, low, high in (
            ("epsilon", 1e-4, 0.999999), ("draws", 16, 100_000), ("seed", 0, 2**32 - 1),
            ("measured_elsewhere", 0, 1), ("catalogue", 0, 1), ("runout_um", 0, 1000),
            ("depth_um", 0, 10_000), ("model", 0, 1),
        ):  # fmt: skip
            value = getattr(self, name)
            if not low <= value <= high:
                raise ValueError(f"certainty.{name} = {value} is out of its range, {low} to {high}")


@dataclass(frozen=True, kw_only=True)
class Grouping:
    """Which blocks share an F or an S.

    Parameters
    ----------
    least_block_s : float
        Blocks are merged until each group takes at least this [s].
    least_gain : float
        An F or S word has to save this share of what the whole part takes [1].
    speeds : {"blocks", "own"}
        Whether S words may be added at any block, or only the program's own changed.
    split : bool
        Whether long straight blocks are split where their engagement changes.
    split_gain : float
        Feed that a part of a block must gain to be split off, as a share [1].
    """

    least_block_s: float = 0.05
    least_gain: float = 1e-4
    speeds: Literal["blocks", "own"] = "blocks"
    split: bool = False
    split_gain: float = 0.2

    def __post_init__(self) -> None:
        for name, high in (("least_block_s", 3600.0), ("least_gain", 1.0), ("split_gain", 100.0)):
            value = getattr(self, name)
            if not 0.0 <= value <= high:
                raise ValueError(f"grouping.{name} = {value} is out of its range, 0 to {high:g}")


@dataclass(frozen=True, kw_only=True)
class SearchSettings:
    """How the answer is sought from the direct solution on, and the baselines beside it.

    Parameters
    ----------
    population, generations : int
        Of the genetic search from the direct solution.
    full : int
        Evaluations of the whole twin at most.
    paper_generations : int
        Of the genetic search from random individuals, as in Sim2023.
    baseline : int
        Evaluations of the best that is found with many; 0 leaves it out.
    front : int
        Members of a Pareto front.
    seed : int
        Of all chance.
    """

    population: int = 48
    generations: int = 40
    full: int = 50
    paper_generations: int = 10
    baseline: int = 5000
    front: int = 48
    seed: int = 0

    def __post_init__(self) -> None:
        for name, low in (
            ("population", 4), ("generations", 1), ("full", 1), ("paper_generations", 1),
            ("baseline", 0), ("front", 4), ("seed", 0),
        ):  # fmt: skip
            value = getattr(self, name)
            if not low <= value <= 1_000_000:
                raise ValueError(f"search.{name} = {value} is out of its range, {low} to 1000000")


@dataclass(frozen=True, kw_only=True)
class OptimisationSettings:
    """The section ``optimisation``: everything but the part itself."""

    certainty: Certainty = field(default_factory=Certainty)
    grouping: Grouping = field(default_factory=Grouping)
    search: SearchSettings = field(default_factory=SearchSettings)
    proof_comment: bool = False
