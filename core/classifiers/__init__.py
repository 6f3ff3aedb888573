"""Small networks that classify a crop of a photo: the viewpoint classifier."""
