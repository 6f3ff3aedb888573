"""Posed images in ShapeNet-SRN's layout, and the objects they are rendered from."""
