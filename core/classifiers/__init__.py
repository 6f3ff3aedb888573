"""Small networks that look at a crop of a photo: its viewpoint, its category."""
