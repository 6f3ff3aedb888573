"""The making of edits: from centimetres, words, pulls on a part, and colours."""
