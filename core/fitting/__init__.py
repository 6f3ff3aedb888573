"""Fitting codes and cameras to images (Eq. 5)."""
