"""Dialects of ISO 6983: Fanuc, LinuxCNC and Sinumerik lines as one form of statement.

Sources: Fanuc 0i-F operator's manual B-64694EN (Macro B); LinuxCNC 2.9 (O-words, parameters);
Sinumerik 840D sl programming manuals.
"""

__all__ = ["expression_parser", "siemens", "statement_parser", "variables"]
