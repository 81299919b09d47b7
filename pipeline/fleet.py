"""Fleet that is built: its machines, and the sub-models that each has records for."""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, kw_only=True)
class Fleet:
    """A fleet, as in ``conf/fleet/``.

    Raises
    ------
    ValueError
        When a list names a machine that the fleet does not have, or that another list lacks
        which it needs.
    """

    name: str
    """Name of the fleet."""
    machines: tuple[str, ...]
    """Machines of the fleet."""
    simulated: tuple[str, ...] = ()
    """Machines whose records the simulated shop floor writes."""
    submodels: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Sub-model -> machines with records for it, in the order in which pages show them."""
    drives_under: Mapping[str, str] = field(default_factory=dict)
    """Machine of ``submodels.following_residual`` -> folder of the drives' model whose errors are
    learnt; one without ``model.json`` where the machine has no such model."""
    optimised: tuple[str, ...] = ()
    """Machines with part programs that are made faster or cheaper inside their limits."""
    trials: tuple[str, ...] = ()
    """Machines where the simulated shop floor cuts these programs before and after."""
    chosen_budget: str = "default"
    """File of ``conf/budget/`` that it is built with."""

    def __post_init__(self) -> None:
        if "compensation" in self.submodels:
            raise ValueError(
                "fleet.submodels.compensation is called following_residual now: rename it in "
                "conf/fleet/"
            )
        lists = {
            "simulated": self.simulated, "optimised": self.optimised, "trials": self.trials,
            **{f"submodels.{name}": some for name, some in self.submodels.items()},
        }  # fmt: skip
        for name, some in lists.items():
            strangers = set(some) - set(self.machines)
            if strangers:
                raise ValueError(
                    f"fleet.{name} names {sorted(strangers)}, which fleet.machines does not: "
                    "add it there"
                )
        lacking = sorted(set(self.submodels.get("following_residual", ())) - set(self.drives_under))
        if lacking:
            raise ValueError(
                f"fleet.submodels.following_residual names {lacking}, which fleet.drives_under "
                "does not: name the folder of the drives' model there"
            )
        for name, needed in NEEDS:
            lacking = sorted(set(lists[name]) - set(lists.get(needed, ())))
            if lacking:
                raise ValueError(
                    f"fleet.{name} names {lacking}, which fleet.{needed} does not: add it there, "
                    "or leave it out"
                )

    def submodels_of(self, machine: str) -> tuple[str, ...]:
        """Sub-models that a machine has records for."""
        return tuple(name for name, some in self.submodels.items() if machine in some)


NEEDS = (("optimised", "submodels.control"), ("trials", "optimised"), ("trials", "simulated"))
"""Lists that a machine of one list has to be in too."""
PARTS = (
    "part programs that are faster or cheaper inside their limits",
    "the part programs, with blank, tool table, material and limits of each in section parts of "
    "the machine’s file",
)
"""Lack of a machine without part programs, and the record for it."""


def missing(fleet: Fleet, machine: str) -> list[tuple[str, str]]:
    """Products that cannot be built for ``machine``, each with what to record for it."""
    from pipeline.submodels.contract import submodel

    known = fleet.submodels_of(machine)
    lacking = [submodel(name) for name in fleet.submodels if name not in known]
    found = [(f"a model of the {one.title}", one.needs) for one in lacking]
    return found if machine in fleet.optimised else [*found, PARTS]
