"""The file formats that can be exported, by the ending of a file's name. Imports nothing, so it loads at once."""

VIDEO_FORMATS = (".mp4", ".gif", ".webp", ".frames")
"""The last is a folder of numbered images."""
TRANSPARENT_FORMATS = (".gif", ".webp", ".frames")
"""Video formats that can have a transparent background."""
MESH_FORMATS = (".glb", ".ply", ".obj")
