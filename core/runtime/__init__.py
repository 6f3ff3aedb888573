"""The lowest layer: threads, number formats, layers, caches, files and reading."""
