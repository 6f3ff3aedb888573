"""Text that the window can draw, and text for file names."""

import re

_CONTROLS = {code: " " for code in (*range(32), *range(127, 160), 0x2028, 0x2029) if chr(code) != "\n"}
_LONGEST = 4096  # characters, those of the longest path
_INVISIBLE = dict.fromkeys(
    (*range(0x200B, 0x2010), *range(0x202A, 0x202F), *range(0x2060, 0x2070), *range(0xFE00, 0xFE10), 0xFEFF)
)  # marks without glyphs: directions of writing, joiners and variants of emoji


def printable(text: object) -> str:
    """Clean text for the window: invalid characters become question marks.

    File names may hold bytes that are not UTF-8, which imgui rejects. Text longer than any path is cut.

    Example:
        >>> printable("bad_\\udcff.png")
        'bad_?.png'
        >>> printable("\u202echair\u2764\ufe0f\x85")
        'chair\u2764 '
    """
    return str(text)[:_LONGEST].encode("utf-8", "replace").decode().translate(_CONTROLS | _INVISIBLE)


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
