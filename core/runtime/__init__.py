"""The ground floor: threads, number formats, layers, caches, files and how they are read."""
