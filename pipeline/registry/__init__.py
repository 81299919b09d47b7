"""Registry of bundles: one registered model a machine, one version for each content.

``data/models/<machine>`` holds the newest bytes and ``data/champion/<machine>`` those that serve,
both owned by DVC; ``champions.json``, which git holds, names the champions; MLflow keeps every
bundle with the code that reads it, in a sqlite file beside the project or on the server of
``MLFLOW_TRACKING_URI``.  MLflow, which takes seconds, is imported to register or load a version
and for a server; a promotion writes to the file itself.
"""

__all__ = ["history", "loading", "provenance", "runs", "sqlite", "store"]
