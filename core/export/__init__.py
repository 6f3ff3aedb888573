"""Meshes, pages, films and their files."""
