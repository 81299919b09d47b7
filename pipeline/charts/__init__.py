"""Parts of pages: figures as SVG, tables, sections, numbers for readers.

Colours are CSS classes and all text is escaped.  ``sources`` reads the files that a page stands on
and remembers the hash of each.
"""

__all__ = [
    "bands", "cases", "judged", "numbers", "parameters", "sections", "sources", "submodel_page",
    "svg", "tables",
    "words",
]  # fmt: skip
