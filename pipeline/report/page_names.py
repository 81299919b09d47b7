"""Names of the pages of a machine, and links between them."""

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


def link(machine: str, subject: str, section: str = "") -> str:
    """Address of a page, or of one of its sections."""
    page = evidence_page(machine, subject)
    return f"{page}#{section}" if section else page
