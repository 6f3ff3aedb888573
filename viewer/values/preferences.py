"""Preferences, kept between launches in a file that may be missing or damaged."""

from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path

from core.runtime.files import write_json
from core.runtime.reading import field_types, optional, read_json, typed
from viewer.values.share_settings import ShareSettings

_FILE = "preferences.json"
_RECENT = 8  # files remembered
_COLOURS = 6  # paints remembered
SMALLEST, LARGEST = 0.75, 2.0  # limits of the text's size, relative to the default


@dataclass(frozen=True)
class Preferences:
    """A person's preferences."""

    dark: bool = True
    text: float = 1.0  # size of the text, relative to the default
    newcomer: bool = True  # the object has never been turned
    share: ShareSettings = field(default_factory=ShareSettings)
    recent: tuple[str, ...] = ()  # paths of opened files, the latest first
    paints: tuple[str, ...] = ()  # chosen paints, such as #c03028, the latest first
    folder: str = ""  # of the last saved file; empty: none was
    front: str = "Mix"  # title of the inspector's panel in front; empty if all are hidden

    def with_text_size(self, text: float) -> "Preferences":
        """Return the preferences with another text size, within its limits."""
        return replace(self, text=max(SMALLEST, min(LARGEST, text)))

    def with_recent(self, path: Path) -> "Preferences":
        """Return the preferences with a file at the head of the recent ones."""
        name = str(path.absolute())
        return replace(self, recent=(name, *(older for older in self.recent if older != name))[:_RECENT])

    def with_paint(self, paint: str) -> "Preferences":
        """Return the preferences with a paint at the head of the chosen ones."""
        return replace(self, paints=(paint, *(older for older in self.paints if older != paint))[:_COLOURS])

    def save(self, folder: Path) -> None:
        """Write the preferences to a folder, creating it. Raises ``ValueError`` or ``OSError`` on failure."""
        folder.mkdir(parents=True, exist_ok=True)
        write_json(folder / _FILE, asdict(self))

    @classmethod
    def load(cls, folder: Path) -> "Preferences":
        """Read the preferences of a folder; the initial ones where the file is missing or invalid."""
        record = optional(lambda: typed(dict, read_json(folder / _FILE))) or {}
        kinds = {name: kind for name, kind in field_types(Preferences).items() if name in record}
        values = {name: optional(partial(typed, kind, record[name])) for name, kind in kinds.items()}
        stored = cls(**{name: value for name, value in values.items() if value is not None})
        return replace(stored.with_text_size(stored.text), recent=stored.recent[:_RECENT])
