"""What is taken from the photo beyond the codes: made after a fit, added to every image of the object."""
