"""Volume rendering: the exact reference, the fast renderer and its jacobian."""
