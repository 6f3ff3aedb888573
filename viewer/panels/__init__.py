"""One subject per file; each panel reads the session and calls its named edits."""

from viewer.desk import Panel
from viewer.panels.camera import CameraPanel
from viewer.panels.codes import CodesPanel
from viewer.panels.export import Export
from viewer.panels.fit import Fit
from viewer.panels.mix import MixPanel
from viewer.panels.objects import Objects
from viewer.panels.plausibility import Plausibility
from viewer.panels.race import RacePanel
from viewer.panels.sheet import SheetPanel
from viewer.panels.speed import SpeedPanel
from viewer.panels.timeline import TimelinePanel
from viewer.panels.view import View
from viewer.panels.visited import Visited


def all_panels() -> list[Panel]:
    """Every docked panel of the window, in the order of their tabs."""
    lower = CodesPanel(), Plausibility(), SheetPanel(), Fit(), Export()
    later = Visited(), TimelinePanel(), CameraPanel(), SpeedPanel()
    return [View(), MixPanel(), Objects(), RacePanel(), *lower, *later]
