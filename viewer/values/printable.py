"""Text that the window can draw, and text for file names."""

import re

_CONTROLS = {code: " " for code in (*range(32), 127) if chr(code) != "\n"}
_LONGEST = 4096  # characters, those of the longest path
_JOINERS = dict.fromkeys((0x200D, *range(0xFE00, 0xFE10)))  # characters that join parts of an emoji: no glyphs


def printable(text: object) -> str:
    """Clean text for the window: invalid characters become question marks.

    File names may hold bytes that are not UTF-8, which imgui rejects. Text longer than any path is cut.

    Example:
        >>> printable("bad_\\udcff.png")
        'bad_?.png'
        >>> printable("\u2764\ufe0f")
        '\u2764'
    """
    return str(text)[:_LONGEST].encode("utf-8", "replace").decode().translate(_CONTROLS | _JOINERS)


def as_label(text: str) -> str:
    """Make text safe as a label or an id of imgui, for which "##" and "###" are signs.

    An invisible space stands between the signs.

    Example:
        >>> as_label("chair##2").split("\u200b")
        ['chair#', '#2']
    """
    return re.sub("#(?=#)", "#\u200b", text)


def file_name(words: str) -> str:
    """Convert words to a file name, without ending, that every system accepts.

    Example:
        >>> file_name("Police car (2)"), file_name("?")
        ('police-car-2', 'object')
    """
    return re.sub(r"\W+", "-", printable(words).lower()).strip("-")[:60] or "object"
