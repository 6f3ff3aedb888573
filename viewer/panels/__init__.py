"""One subject per file; each panel reads the session and calls its named edits."""

from viewer.context import Panel
from viewer.panels.camera import CameraPanel
from viewer.panels.candidates import CandidatesPanel
from viewer.panels.grid import GridPanel
from viewer.panels.history import HistoryPanel
from viewer.panels.library import LibraryPanel
from viewer.panels.log import LogPanel
from viewer.panels.mix import MixPanel
from viewer.panels.performance import PerformancePanel
from viewer.panels.photo import PhotoPanel
from viewer.panels.realism import RealismPanel
from viewer.panels.sliders import SlidersPanel
from viewer.panels.timeline import TimelinePanel
from viewer.panels.view import ViewPanel


def all_panels() -> list[Panel]:
    """Every docked panel of the window, in the order of their tabs."""
    inspector = MixPanel(), SlidersPanel(), PhotoPanel(), RealismPanel(), GridPanel()
    drawer = TimelinePanel(), CandidatesPanel(), CameraPanel(), PerformancePanel(), LogPanel()
    return [LibraryPanel(), ViewPanel(), *inspector, *drawer, HistoryPanel()]
