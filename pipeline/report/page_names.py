"""Names of the pages of a machine, and links between them."""

import re
from collections.abc import Iterable

PROGRAMS = "programs"
"""Page of part programs: as they run, optimised, corrected."""
RECORDS = "records"
"""Page of what was read: work, alarms, records, truth, provenance."""


def evidence_page(machine: str, subject: str) -> str:
    """File of the page on one subject: a sub-model, :data:`PROGRAMS` or :data:`RECORDS`.

    >>> evidence_page("mill01", "drive")
    'mill01_drive.html'
    """
    return f"{machine}_{subject}.html"


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


def link(machine: str, subject: str, section: str = "") -> str:
    """Address of a page, or of one of its sections."""
    page = evidence_page(machine, subject)
    return f"{page}#{section}" if section else page
