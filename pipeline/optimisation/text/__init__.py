"""Text of a program with its editable F and S; every other byte stays."""

__all__ = ["editable_blocks", "rewrite", "split", "words"]
