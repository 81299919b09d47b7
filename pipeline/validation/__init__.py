"""The golden week: what a model must show before it may serve."""
