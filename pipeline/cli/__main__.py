"""``python -m pipeline.cli …`` is ``kerf …``."""

from pipeline.cli import main

main()
