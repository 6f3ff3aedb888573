"""One subject per file; each panel reads the session and calls its named edits."""

from viewer.context import Panel
from viewer.panels.camera import CameraPanel
from viewer.panels.candidates import RacePanel
from viewer.panels.export import Export
from viewer.panels.fit import Fit
from viewer.panels.grid import SheetPanel
from viewer.panels.history import Visited
from viewer.panels.mix import MixPanel
from viewer.panels.objects import Objects
from viewer.panels.performance import SpeedPanel
from viewer.panels.realism import Plausibility
from viewer.panels.sliders import CodesPanel
from viewer.panels.timeline import TimelinePanel
from viewer.panels.view import View


def all_panels() -> list[Panel]:
    """Every docked panel of the window, in the order of their tabs."""
    lower = CodesPanel(), Plausibility(), SheetPanel(), Fit(), Export()
    later = Visited(), TimelinePanel(), CameraPanel(), SpeedPanel()
    return [View(), MixPanel(), Objects(), RacePanel(), *lower, *later]
