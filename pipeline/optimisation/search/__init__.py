"""Searches from the direct solution on, the baselines, and the front."""
