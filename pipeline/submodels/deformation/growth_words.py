"""Words of the page of spindle growth: micrometres, names of recordings, what was judged."""

from pipeline.charts.numbers import TOGETHER, counted, fixed
from pipeline.charts.sources import Source
from pipeline.charts.tables import sources
from pipeline.submodels.deformation.growth_facts import GrowthFacts


def um(value: float | None, decimals: int = 1) -> str:
    """A length with one decimal and its unit."""
    return "not known" if value is None else f"{fixed(value, decimals)}{TOGETHER}µm"


def whole_um(value: float) -> str:
    """A length in whole micrometres."""
    return f"{fixed(value, 0)}{TOGETHER}µm"


def short(case: str) -> str:
    """Name of a recording as a person says it: its file without folder and ending.

    >>> short("growth/profile-18-warm-up.csv")
    'profile-18-warm-up'
    """
    return case.rpartition("/")[2].rpartition(".")[0] or case


def judged_on(facts: GrowthFacts) -> str:
    """Recordings that decide, with their number."""
    many = counted(len(facts.ranked()), "recording")
    return f"{many} {'of its golden set' if facts.role == 'golden' else 'held out of its fit'}"


def made_from(facts: GrowthFacts, *files: str) -> list[Source]:
    """Files of the sub-model as sources."""
    return sources(facts.shown.shelf, *(facts.shown.folder / file for file in files))
