"""Tools of the mouse over the view: wipe, erase, pick a colour, pull the shape."""

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
        """Draw over the view, imgui's last item; return whether the tool takes the mouse.

        Args:
            corner: upper left corner of the view, px on screen.
            size: size of the view, px.
        """


class OverView:
    """All tools: those of :attr:`viewer.context.PanelContext.tool`, and the one of the key G."""

    def __init__(self) -> None:
        self._tools: dict[str, Tool] = {"wipe": Comparison(), "erase": Eraser(), "pick": Eyedropper()}
        self._grab = Grab()

    def draw(self, context: PanelContext, corner: ImVec2, size: ImVec2) -> bool:
        """Draw the current tool over the view, imgui's last item; return whether it takes the mouse."""
        if self._grab.draw(context, corner, size):
            return True
        if imgui.is_key_pressed(imgui.Key.escape):
            context.tool = "turn"
        tool = self._tools.get(context.tool)
        return tool is not None and tool.draw(context, corner, size)
