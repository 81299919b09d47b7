"""Searches for the least cost that ask for no gradient: arrays and bounds only."""
