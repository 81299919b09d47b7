"""Report: one offline page for the fleet, one for each machine, for screen and paper.

Pages are HTML files that load nothing; no script runs but that of an optimised program.  A
machine's page is made of what its sub-models make of their files (``SubModel.page``), of its
records and its work; each of its programs has a page of its own, which is that of the command.
Times are in UTC; numbers carry their units; every figure and table names the files that it was made
from, with their SHA-256, in words, in its title and in a record beside the page.
"""

__all__ = [
    "cut", "folders", "optimised", "pages", "programs", "provenance", "standalone_page", "texts",
]  # fmt: skip
