"""Training a field and its codes from posed images (Eq. 4)."""
