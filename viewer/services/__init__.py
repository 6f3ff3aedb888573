"""Services that everything else calls on: the worker, where values come from, messages, the clipboard."""
