"""What the program remembers of a person from one launch to the next, in a small file that may be lost or broken."""

import json
import math
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

from core.files import write_json
from viewer.values.quality import DEFAULT_QUALITY, QUALITIES

_FILE = "preferences.json"
_RECENT = 8
"""files remembered"""
SMALLEST, LARGEST = 0.75, 2.0
"""of the text, relative to the default"""


@dataclass(frozen=True)
class Preferences:
    """Values that a person chose. A new choice is a new one of these."""

    dark: bool = True
    smooth: bool = True
    """the finished render, enlarged, without visible pixels; previews show theirs, so that they are known as such"""
    text: float = 1.0
    """size of the text, relative to the default"""
    quality: int = DEFAULT_QUALITY
    """which of :data:`viewer.values.quality.QUALITIES`"""
    newcomer: bool = True
    """nobody has turned the object yet"""
    recent: tuple[str, ...] = ()
    """paths of images and scenes that were opened, the last one first"""

    def with_text_size(self, text: float) -> "Preferences":
        """With a larger or smaller text, within reason."""
        return replace(self, text=max(SMALLEST, min(LARGEST, text)))

    def with_recent(self, path: Path) -> "Preferences":
        """With a file at the head of the recent ones."""
        name = str(path.absolute())
        return replace(self, recent=(name, *(other for other in self.recent if other != name))[:_RECENT])

    def save(self, folder: Path) -> None:
        """Write them into a folder, which is made. Raises ``ValueError`` or ``OSError`` where that cannot be."""
        folder.mkdir(parents=True, exist_ok=True)
        write_json(folder / _FILE, asdict(self))

    @classmethod
    def load(cls, folder: Path) -> "Preferences":
        """Read them; what is missing or makes no sense is as on the first launch."""
        try:
            stored = json.loads((folder / _FILE).read_text())
        except (OSError, ValueError):
            return cls()
        if not isinstance(stored, dict):
            return cls()
        default = cls()
        kept = {
            field.name: stored[field.name]
            for field in fields(cls)
            if field.name != "recent" and _same_type(stored.get(field.name), getattr(default, field.name))
        }
        recent = stored.get("recent")
        names = tuple(name for name in recent if isinstance(name, str)) if isinstance(recent, list) else ()
        found = cls(**kept, recent=names[:_RECENT]).with_text_size(kept.get("text", default.text))
        return found if 0 <= found.quality < len(QUALITIES) else replace(found, quality=default.quality)


def _same_type(value: object, default: object) -> bool:
    if isinstance(default, float):
        return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    return type(value) is type(default)
