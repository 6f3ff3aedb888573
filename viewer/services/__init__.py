"""The worker, the backend, messages, the clipboard, and files kept between launches."""
