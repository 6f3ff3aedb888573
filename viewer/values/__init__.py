"""Frozen values and pure functions of them, without threads or screen."""
