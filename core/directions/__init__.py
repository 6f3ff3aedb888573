"""Directions of the code spaces: their words, and the one that a pull on a point finds."""
