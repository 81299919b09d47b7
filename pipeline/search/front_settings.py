"""How a front of answers to several objectives is searched."""

from dataclasses import dataclass

from pipeline.search.genetic_settings import GeneticSettings


@dataclass(frozen=True, kw_only=True)
class FrontSettings:
    """How NSGA-II searches; the defaults are those of Deb et al. 2002.

    Parameters
    ----------
    population : int
        Individuals P, and children of a generation; at least 4.
    generations : int
        Generations at most, the first population among them.
    crossover_rate, gene_rate : float
        Share of the pairs that cross, and of their genes.
    crossover_eta, mutation_eta : float
        Distribution indices of crossover and mutation.
    mutation_rate : float, optional
        Share of the genes that mutate, 1 / D unless given.
    seed : int
        Of all chance.

    Raises
    ------
    ValueError
        When a setting is out of its range.
    """

    population: int = 100
    generations: int = 250
    crossover_rate: float = 0.9
    gene_rate: float = 0.5
    crossover_eta: float = 20.0
    mutation_eta: float = 20.0
    mutation_rate: float | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if self.population < 4:
            raise ValueError(f"front.population = {self.population} must be at least 4")
        _ = self.breeding

    @property
    def breeding(self) -> GeneticSettings:
        """The same for :func:`~pipeline.search.breeding.offspring`: as many children as parents."""
        return GeneticSettings(
            population=self.population, generations=self.generations, seed=self.seed,
            selection="tournament", tournament=2, elite=0,
            crossover_rate=self.crossover_rate, gene_rate=self.gene_rate,
            crossover_eta=self.crossover_eta, mutation_eta=self.mutation_eta,
            mutation_rate=self.mutation_rate,
        )  # fmt: skip
