"""One subject per file; each panel reads the workspace and calls its named edits."""

from viewer.context import Panel
from viewer.panels.camera import CameraPanel
from viewer.panels.candidates import CandidatesPanel
from viewer.panels.fit import FitPanel
from viewer.panels.grid import GridPanel
from viewer.panels.history import HistoryPanel
from viewer.panels.mix import MixPanel
from viewer.panels.objects import ObjectsPanel
from viewer.panels.performance import PerformancePanel
from viewer.panels.realism import RealismPanel
from viewer.panels.sliders import SlidersPanel
from viewer.panels.timeline import TimelinePanel
from viewer.panels.view import ViewPanel


def all_panels() -> list[Panel]:
    """Every docked panel of the window, in the order of their tabs."""
    top = MixPanel(), ObjectsPanel(), CandidatesPanel()
    lower = SlidersPanel(), RealismPanel(), GridPanel(), FitPanel()
    strip = HistoryPanel(), TimelinePanel(), CameraPanel(), PerformancePanel()
    return [ViewPanel(), *top, *lower, *strip]
