"""The text of a program: which F and S may change, and how they are written."""
