"""Services: the worker, the backend, messages, the clipboard, files kept between launches."""
