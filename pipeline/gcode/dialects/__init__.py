"""Dialects of ISO 6983: how Fanuc, LinuxCNC and Sinumerik lines are parsed, and their variables.

Every dialect's line becomes the same :class:`~pipeline.gcode.statements.Statement`, so that the
interpreter does not depend on the notation.

Sources: Fanuc 0i-F operator's manual B-64694EN (Macro B); LinuxCNC 2.9 (O-words, parameters);
Sinumerik 840D sl programming manuals.
"""

__all__ = ["expression_parser", "siemens", "statement_parser", "variables"]
