"""The laboratory: datasets, training, evaluation and benchmarks. Only the command line imports it."""
