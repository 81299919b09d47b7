"""Folders of a machine as input of its page, and the state of the project."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")
"""Names that a machine may have: a name becomes a file name and a link."""


@dataclass(frozen=True, kw_only=True)
class MachineFolders:
    """Folders, files and description of one machine."""

    name: str
    """The machine's name in the fleet; names its page, ``<name>.html``."""
    signals: Path
    clean: Path
    models: Path
    """Folders ``data/signals/<machine>``, ``data/clean/<machine>``, ``data/models/<machine>``; each
    may be absent or hold a part of its files only."""
    golden: Path
    """File ``data/golden/<machine>.json``; may be absent."""
    origin: Literal["simulated", "recorded"]
    """Origin of the records; simulated results are labelled wherever they stand."""
    submodels: tuple[str, ...] = ()
    """Sub-models that the machine has records for, in the order of its page."""
    truth: Path | None = None
    """JSON of what a simulated machine really is; None for recorded machines."""
    programs: Path | None = None
    """Folder ``data/programs/<machine>`` of simulated programs; may be absent."""
    champion: Path | None = None
    """Folder ``data/champion/<machine>`` of the models that serve; may be absent."""
    history: Path | None = None
    """File ``data/history/<machine>.jsonl`` of what served when; may be absent."""
    parts: Path | None = None
    """Folder ``data/parts/<machine>`` of optimised programs; may be absent."""
    trial: Path | None = None
    """JSON of what the simulated shop floor made of them; None where none was cut."""
    ledger: Path | None = None
    """JSON lines ``data/ledger/<machine>.jsonl`` of the nights of what serves; may be absent."""
    twin_state: Path | None = None
    """Folder ``data/twin_state/<machine>`` of what the champion estimates; may be absent."""
    condition: Path | None = None
    """Folder ``data/condition/<machine>`` of the reports by week; may be absent."""
    incidents: Path | None = None
    """JSON ``data/incidents/<machine>.json`` of what monitoring found; may be absent."""
    corrected: Path | None = None
    """JSON of corrected commands driven on the simulated shop floor; None where none were."""
    settings: Path | None = None
    """JSON with the hashes of the machine's settings by section; may be absent."""
    type: str = ""
    """Type of the machine; empty where its file names none."""
    siblings: Mapping[str, Path] = field(default_factory=dict)
    """Folders of the models of the fleet's other machines of its type, by their names."""
    description: str = ""
    """Description of the machine in a sentence."""
    credit: str = ""
    """Whose recording it is; shown wherever results on it are shown."""
    missing: tuple[tuple[str, str], ...] = ()
    """Missing records of the machine, and what to record."""

    def __post_init__(self) -> None:
        if not NAME.fullmatch(self.name) or self.name == "index":
            raise ValueError(
                f"machine name {self.name!r} cannot name a page; "
                "use letters, digits, '_', '-', '.' and not 'index'"
            )
        if self.origin not in ("simulated", "recorded"):
            raise ValueError(
                f"origin of machine {self.name} is {self.origin!r}; say 'simulated' or 'recorded'"
            )


@dataclass(frozen=True, kw_only=True)
class FleetInfo:
    """State of the project as a whole."""

    name: str = "fleet"
    """Name of the fleet."""
    git_commit: str | None = None
    params_sha256: str | None = None
    """State of the code and of params.yaml that the results come from; None without it."""
    code: str = ""
    """Hash of the code that makes the pages; empty where it is not known."""
    budget: str = "default"
    """Name of the budget that the stages ran under."""
    notes: tuple[str, ...] = ()
    """Remarks on the budget's cuts, or anything else that every reader must see."""
    versions: dict[str, str] = field(default_factory=dict)
    """Versions of the libraries that the numbers depend on."""

    @property
    def libraries(self) -> str:
        """Names and versions of the libraries."""
        return ", ".join(f"{name} {version}" for name, version in sorted(self.versions.items()))


PROGRAMS = "programs"
"""Page of part programs: as they run, optimised, corrected."""
CHOICES = "promotions and rollbacks"
"""Work that writes histories and decisions."""
RECORDS = "records"
"""Page of what was read: work, alarms, records, truth, provenance."""


def evidence_page(machine: str, subject: str) -> str:
    """File of the page on one subject: a sub-model, :data:`PROGRAMS` or :data:`RECORDS`.

    >>> evidence_page("mill01", "drive")
    'mill01_drive.html'
    """
    return f"{machine}_{subject}.html"


def link(machine: str, subject: str, section: str = "") -> str:
    """Address of a page, or of one of its sections."""
    page = evidence_page(machine, subject)
    return f"{page}#{section}" if section else page


def program_pages(machine: str, programs: Iterable[str]) -> dict[str, str]:
    """File of the page of each program of a machine.

    >>> program_pages("mill01", ["O1 (Front)", "O1 Front"])
    {'O1 (Front)': 'mill01_program_O1_Front.html', 'O1 Front': 'mill01_program_O1_Front_2.html'}
    """
    files: dict[str, str] = {}
    for name in programs:
        plain = re.sub(r"[^A-Za-z0-9_.-]+", "_", name).strip("_")
        again = sum(file.startswith(f"{machine}_program_{plain}") for file in files.values())
        end = f"_{again + 1}" if again else ""
        files[name] = evidence_page(machine, f"program_{plain}{end}")
    return files
