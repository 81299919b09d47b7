"""``python -m pipeline.app …`` is ``kerf …``."""

from pipeline.app import main

main()
