"""An interactive latent-editing viewer in a window."""
