"""The interactive window: a viewer that edits latent codes."""
