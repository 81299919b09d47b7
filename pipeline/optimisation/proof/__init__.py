"""Proof that two programs differ in F and S words alone, by text and by moves, to the last bit."""

__all__ = ["prove"]
