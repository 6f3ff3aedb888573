"""Measurements of speed, accuracy and robustness, and the charts drawn from them."""
