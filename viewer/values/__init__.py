"""What there is to know: frozen values, and pure functions of them. Knows no thread and no screen."""
