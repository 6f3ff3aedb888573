"""Widgets, most of them of several panels."""
