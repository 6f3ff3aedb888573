"""Frozen values, and pure functions of them: no threads, no screen."""
