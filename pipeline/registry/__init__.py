"""The registry of bundles: one registered model a machine, one version for each content.

``data/models/<machine>`` holds the newest bytes and ``data/champion/<machine>`` those that serve,
both owned by DVC; ``champions.json``, which git holds, names the champions.  MLflow keeps every
bundle that there ever was, with the code that reads it.  The default store is a sqlite file beside
the project; ``MLFLOW_TRACKING_URI`` names a server instead.  MLflow is imported only where a
version is written or loaded: importing it takes seconds, and what is there can be read without.
``store`` reads what is registered and names it, ``runs`` registers, ``provenance`` says what a
bundle was made of, ``card`` what it is for, ``loading`` brings a version back.
"""

__all__ = ["card", "loading", "provenance", "runs", "store"]
