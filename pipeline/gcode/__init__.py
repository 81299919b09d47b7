"""Part programs (ISO 6983) of Fanuc, LinuxCNC and Sinumerik controls: text to moves and back.

A program is parsed without loss of a byte, interpreted under the control's setup, and becomes rows
of moves in the machine's frame [mm, deg].  Compiled code carries out fast lines (G0 to G3 and
numbers only) with the same bits as the interpreter.

Sources: ISO 6983-1; Fanuc 0i-F operator's manual B-64694EN; LinuxCNC 2.9 documentation, G-code
reference; Sinumerik 840D sl programming manuals.
"""

__all__ = ["errors", "interpret", "moves", "program", "scanner", "setup"]
