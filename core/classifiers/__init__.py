"""A small network that looks at a crop of a photo: its viewpoint."""
