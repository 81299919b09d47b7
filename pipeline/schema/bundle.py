"""A machine's bundle (all its sub-models by hash) and the champions that serve."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from pipeline.schema.verdict import Status


@dataclass(frozen=True, kw_only=True)
class BundledModel:
    """One sub-model of a bundle: hash over its files, and its verdict's status."""

    sha256: str
    status: Status


@dataclass(frozen=True, kw_only=True)
class Bundle:
    """The content of ``bundle.json``: a machine and its sub-models.

    Parameters
    ----------
    machine, origin : str
        Whose, and of which records.
    submodels : mapping of str to BundledModel
        By the name of the sub-model.
    sha256 : str
        Of the whole: over the names and hashes of its sub-models.
    """

    machine: str
    origin: str
    submodels: Mapping[str, BundledModel]
    sha256: str


@dataclass(frozen=True, kw_only=True)
class Champion:
    """The bundle that serves a machine: since when, by whom and why."""

    version: int
    bundle: str
    since: str
    by: str
    why: str


@dataclass(frozen=True, kw_only=True)
class SealedLook:
    """One scoring of the sealed set: each look spends some of its worth, so each is counted."""

    machine: str
    bundle: str
    sealed: str
    at: str
    outcome: str


@dataclass(frozen=True, kw_only=True)
class Champions:
    """The content of ``champions.json``, which git holds: a promotion is a commit."""

    machines: Mapping[str, Champion] = field(default_factory=dict)
    looks: tuple[SealedLook, ...] = ()
