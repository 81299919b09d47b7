"""How the genetic algorithm searches."""

from dataclasses import dataclass
from math import inf, isfinite, isnan

CHOICES = {
    "selection": ("tournament", "stochastic_universal"),
    "crossover": ("sbx", "blend"),
    "survival": ("truncation", "replacement"),
    "fitness": ("rank", "exponential", "window"),
}


@dataclass(frozen=True, kw_only=True)
class GeneticSettings:
    """How the genetic algorithm searches.

    Parameters
    ----------
    population : int
        Individuals P, at least 2.
    generations : int
        Generations at most, the first population among them.
    selection : str
        ``tournament`` or ``stochastic_universal``.
    tournament : int
        Competitors for each parent's place.
    fitness : str
        What stochastic universal selection and the adaptive rates go by: ``rank``, ``exponential``
        (FFNN2015) or ``window``, how much better than the worst.
    crossover : str
        ``sbx`` (simulated binary) or ``blend``.
    crossover_eta : float
        Distribution index of ``sbx``.
    alpha : float
        Widening of ``blend``.
    crossover_rate : float
        Share of the pairs that cross; with ``adaptive`` the greatest.
    gene_rate : float
        Share of a crossing pair's genes that cross.
    mutation_rate : float, optional
        Share of the genes that mutate, 1 / D unless given; with ``adaptive`` the greatest.
    mutation_eta : float
        Distribution index of polynomial mutation.
    elite : int
        Best individuals that always stay.
    generation_gap : float
        Children of a generation as a share of the population, above 0 to 1; never so many that the
        elite had no place.
    survival : str
        ``truncation``: the best of parents and children together stay; ``replacement``: all
        children do, in place of the worst parents.
    adaptive : bool
        Rates by fitness (Srinivas and Patnaik 1994): the best are disrupted least.
    limit : float
        Cost at which the search ends.
    stall : int, optional
        Generations without a gain of more than ``stall_gain`` after which the search ends.
    stall_gain : float
        In the cost's unit.
    seed : int
        Of all chance.

    Raises
    ------
    ValueError
        When a setting is out of its range.
    """

    population: int = 64
    generations: int = 100
    selection: str = "stochastic_universal"
    tournament: int = 2
    fitness: str = "exponential"
    crossover: str = "sbx"
    crossover_eta: float = 5.0
    alpha: float = 0.5
    crossover_rate: float = 1.0
    gene_rate: float = 1.0
    mutation_rate: float | None = None
    mutation_eta: float = 20.0
    elite: int = 1
    generation_gap: float = 1.0
    survival: str = "truncation"
    adaptive: bool = False
    limit: float = -inf
    stall: int | None = None
    stall_gain: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        for name, least, most in (
            ("population", 2, inf),
            ("generations", 1, inf),
            ("tournament", 1, inf),
            ("crossover_eta", 0, 1000),
            ("alpha", 0, 10),
            ("crossover_rate", 0, 1),
            ("gene_rate", 0, 1),
            ("mutation_rate", 0, 1),
            ("mutation_eta", 0, 1000),
            ("elite", 0, self.population - 1),
            ("stall", 1, inf),
            ("stall_gain", 0, inf),
            ("seed", 0, inf),
        ):
            value = getattr(self, name)
            if value is not None and not (isfinite(value) and least <= value <= most):
                raise ValueError(f"genetic.{name} = {value} must lie in {least} to {most}")
        for name in ("population", "generations", "tournament", "elite", "stall", "seed"):
            value = getattr(self, name)
            if value is not None and value != int(value):
                raise ValueError(f"genetic.{name} = {value} must be a whole number")
        if not 0 < self.generation_gap <= 1:
            raise ValueError(
                f"genetic.generation_gap = {self.generation_gap} must lie above 0, at most 1"
            )
        if isnan(self.limit):
            raise ValueError("genetic.limit = nan must be a cost, or -inf for none")
        for name, choices in CHOICES.items():
            if getattr(self, name) not in choices:
                raise ValueError(
                    f"genetic.{name} = {getattr(self, name)!r} is not one of {', '.join(choices)}"
                )

    @property
    def children(self) -> int:
        """Children of each generation [1]."""
        most = self.population - self.elite
        return min(max(round(self.generation_gap * self.population), 1), most)
