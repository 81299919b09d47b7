"""Baselines that the judge compares a model with, in words for the pages."""

from pipeline.report.texts import ENGLISH, Texts


def baseline_words(name: str, say: Texts = ENGLISH) -> str:
    """A baseline in words; its own name, without underscores, where the texts do not list it."""
    key = f"baseline.{name}"
    return say(key) if say.has(key) else name.replace("_", " ")
