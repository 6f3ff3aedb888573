"""Tools for the mouse over the view: wipe, erase, take a colour, pull the shape."""

from typing import Protocol

from imgui_bundle import ImVec2, imgui

from viewer.context import PanelContext
from viewer.widgets.comparison import Comparison
from viewer.widgets.eraser import Eraser
from viewer.widgets.grab import Grab
from viewer.widgets.paint import Eyedropper


class Tool(Protocol):
    """A tool that draws over the view."""

    def draw(self, context: PanelContext, corner: ImVec2, size: ImVec2) -> bool:
        """Draw over the view, which is imgui's last item; return whether the tool takes the mouse."""


class OverView:
    """The tools by their names in :attr:`viewer.context.PanelContext.tool`, and the one of a held key."""

    def __init__(self) -> None:
        self._tools: dict[str, Tool] = {"wipe": Comparison(), "erase": Eraser(), "pick": Eyedropper()}
        self._grab = Grab()

    def draw(self, context: PanelContext, corner: ImVec2, size: ImVec2) -> bool:
        """Draw the tool in use over the view, which is imgui's last item; return whether it takes the mouse."""
        if self._grab.draw(context, corner, size):
            return True
        if imgui.is_key_pressed(imgui.Key.escape):
            context.tool = "turn"
        tool = self._tools.get(context.tool)
        return tool is not None and tool.draw(context, corner, size)
