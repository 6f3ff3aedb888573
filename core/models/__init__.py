"""The conditional radiance field, its codes, and the files that hold them."""
