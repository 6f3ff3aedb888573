"""The operating system's window: its runner, theme, textures and file dialog."""
