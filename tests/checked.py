"""The run-time type check that the tests lay over core: shapes and types of every annotated call."""

from beartype import BeartypeConf, beartype

# An int is a fine float, as everywhere in Python's typing.
checked = beartype(conf=BeartypeConf(is_pep484_tower=True))
