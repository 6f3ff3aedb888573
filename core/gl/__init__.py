"""The field baked into a 3D texture, and everything that OpenGL draws."""
