"""``kerf …``: what a person does by hand."""

from pipeline.cli import fleet, programs  # before optimise: their order is that of the help
from pipeline.cli import optimise as optimise
from pipeline.cli.kerf import app

__all__ = ["app", "fleet", "main", "optimise", "programs"]


def main() -> None:
    """Entry point of the command ``kerf``."""
    app()
