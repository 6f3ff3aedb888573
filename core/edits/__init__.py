"""Edits of an object as values: what each does to space, density and colour."""
