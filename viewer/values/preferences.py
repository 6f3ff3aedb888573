"""Preferences, kept between launches in a file that may be missing or damaged."""

import math
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from core.runtime.files import write_json
from core.runtime.reading import optional, read_json
from viewer.values.share_settings import ShareSettings

_FILE = "preferences.json"
_RECENT = 8  # files remembered
SMALLEST, LARGEST = 0.75, 2.0  # limits of the text's size, relative to the default


@dataclass(frozen=True)
class Preferences:
    """A person's preferences."""

    dark: bool = True
    text: float = 1.0  # size of the text, relative to the default
    newcomer: bool = True  # the object has never been turned
    share: ShareSettings = field(default_factory=ShareSettings)
    recent: tuple[str, ...] = ()  # paths of opened files, the latest first

    def with_text_size(self, text: float) -> "Preferences":
        """Return the preferences with another text size, within its limits."""
        return replace(self, text=max(SMALLEST, min(LARGEST, text)))

    def with_recent(self, path: Path) -> "Preferences":
        """Return the preferences with a file at the head of the recent ones."""
        name = str(path.absolute())
        return replace(self, recent=(name, *(other for other in self.recent if other != name))[:_RECENT])

    def save(self, folder: Path) -> None:
        """Write the preferences to a folder, creating it. Raises ``ValueError`` or ``OSError`` on failure."""
        folder.mkdir(parents=True, exist_ok=True)
        write_json(folder / _FILE, asdict(self))

    @classmethod
    def load(cls, folder: Path) -> "Preferences":
        """Read the preferences of a folder; missing or invalid values get their defaults."""
        stored = optional(lambda: read_json(folder / _FILE))
        if not isinstance(stored, dict):
            return cls()
        default, kept = cls(), _kept(cls(), stored)
        recent = stored.get("recent")
        names = tuple(name for name in recent if isinstance(name, str)) if isinstance(recent, list) else ()
        share = _share(stored.get("share"))
        return cls(**kept, share=share, recent=names[:_RECENT]).with_text_size(kept.get("text", default.text))


def _share(stored: object) -> ShareSettings:
    """Read the choices of the Share dialog, all of them or none."""
    try:
        return ShareSettings(**_kept(ShareSettings(), stored)) if isinstance(stored, dict) else ShareSettings()
    except ValueError:
        return ShareSettings()


def _kept(default: Any, stored: dict) -> dict[str, Any]:
    """Return the stored truth values, numbers and texts that have the type of the default."""
    return {
        one.name: stored[one.name]
        for one in fields(default)
        if isinstance(getattr(default, one.name), bool | int | float | str)
        and _same_type(stored.get(one.name), getattr(default, one.name))
    }


def _same_type(value: object, default: object) -> bool:
    if isinstance(default, float):
        return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    return type(value) is type(default)
