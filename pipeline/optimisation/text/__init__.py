"""Text of a program: which F and S may change, and how they are written; every other byte stays."""

__all__ = ["editable_blocks", "modal_words", "rewrite", "split", "words"]
