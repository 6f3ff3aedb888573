"""The panels and dialogs, one subject per file; each reads the session and calls its methods."""

from viewer.context import Panel
from viewer.panels.developer import DeveloperPanel
from viewer.panels.library import LibraryPanel
from viewer.panels.mix import MixPanel
from viewer.panels.photo import PhotoPanel
from viewer.panels.sliders import SlidersPanel
from viewer.panels.view import ViewPanel


def all_panels() -> list[Panel]:
    """Return all docked panels of the window, in the order of their tabs."""
    return [LibraryPanel(), ViewPanel(), MixPanel(), SlidersPanel(), PhotoPanel(), DeveloperPanel()]
