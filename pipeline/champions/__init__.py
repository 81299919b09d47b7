"""Champions: the bundle of each machine that serves, and its replacement by another.

``data/history/<machine>.jsonl`` says who served when, by whom and why, and ``champions.json`` what
serves at present; git holds both, so that a promotion is a commit.  ``data/champion`` holds the
files, ``data/warm`` those of the one before; the aliases in the registry follow.
"""

__all__ = ["challenge", "promotion", "serving"]
