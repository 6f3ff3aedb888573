"""Services used everywhere: the worker, the backend, messages, the clipboard."""
