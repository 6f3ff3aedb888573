"""Benchmarks of speed, accuracy and robustness, and their tables and charts."""
