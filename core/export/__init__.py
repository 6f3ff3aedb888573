"""Meshes, keyframes and videos."""
