"""How edits are made: from centimetres, words, pulls on a part, and colours."""
