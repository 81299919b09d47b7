"""Report: one offline page for the fleet, one for each machine, for screen and paper.

Pages are HTML files that load nothing and run no script.  A machine's page is made of what its
sub-models make of their files (``SubModel.page``), of its records, its work, its programs and its
optimised parts.  Times are in UTC; numbers carry their units; every figure and table names the
files that it was made from, with their SHA-256.
"""

__all__ = [
    "cut", "folders", "optimised_page", "pages", "programs", "settings", "standalone_page", "texts",
]  # fmt: skip
