"""The commands of ``codenerf``, or ``python -m core``."""
