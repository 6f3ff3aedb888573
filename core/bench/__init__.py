"""Measurements behind the charts: each is one command, runs on the machine at hand and compares within one run."""
