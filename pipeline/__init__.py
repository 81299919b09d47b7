"""Kerf: the digital twin of a machine tool, rebuilt from the machine's own records."""
