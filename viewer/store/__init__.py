"""Kept work: objects, undo histories, fits, waiting photos and last images, in SQLite."""
