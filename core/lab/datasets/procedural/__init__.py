"""Procedural objects: shapes and textures from seeds."""
