"""The window of the operating system: its runner, theme, textures and file dialog."""
