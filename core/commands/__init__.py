"""What the commands do: each reads the parsed words of :mod:`core.__main__` and drives a stream to its end."""
