"""Part programs (ISO 6983) of Fanuc, LinuxCNC and Sinumerik controls: text to moves and back.

A program is parsed without loss of a byte (``program``), interpreted under the control's setup
(``setup``, ``interpret``) and becomes rows of moves in the machine's frame (``moves``) [mm, deg]:
straight lines, arcs, dwells, tool changes, spindle commands.  Most lines of a part program hold
G0 to G3 and numbers only; compiled code carries these fast lines out with the same bits as the
interpreter.  ``dialects`` holds what each control writes differently, ``codes`` what each G and M
code does.

Sources: ISO 6983-1; Fanuc 0i-F operator's manual B-64694EN; LinuxCNC 2.9 documentation, G-code
reference; Sinumerik 840D sl programming manuals.
"""

__all__ = ["errors", "interpret", "moves", "program", "restart", "scanner", "setup"]
