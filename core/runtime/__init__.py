"""What everything stands on: threads, number formats, layers, caches, files and how they are read."""
