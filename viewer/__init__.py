"""The window: an interactive latent-editing viewer."""
