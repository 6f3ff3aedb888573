"""Preferences, kept between launches in a file that may be missing or damaged."""

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from core.runtime.files import write_json
from core.runtime.reading import optional, read_json, typed
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
        """Read the preferences of a folder; the initial ones if the file is missing or invalid."""
        stored = optional(lambda: typed(cls, read_json(folder / _FILE), name="preferences")) or cls()
        return replace(stored.with_text_size(stored.text), recent=stored.recent[:_RECENT])
