"""Cameras, rays and samples along them."""
