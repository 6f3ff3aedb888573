"""Photo detail: colours of the photo that the codes cannot express, added to every image of the object."""
