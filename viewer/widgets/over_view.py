"""Tools of the mouse over the view: wipe, erase, pick a colour, and the handle of the clicked part."""

from typing import Protocol

from imgui_bundle import ImVec2, imgui

from viewer.context import PanelContext
from viewer.widgets.comparison import Comparison
from viewer.widgets.eraser import Eraser
from viewer.widgets.paint import Eyedropper
from viewer.widgets.part_handle import PartHandle


class Tool(Protocol):
    """A tool that draws over the view."""

    def draw(self, context: PanelContext, corner: ImVec2, size: ImVec2) -> bool:
        """Draw over the view, imgui's last item; return whether the tool takes the mouse.

        Args:
            corner: upper left corner of the view, px on screen.
            size: size of the view, px.
        """


class OverView:
    """The tools of :attr:`viewer.context.PanelContext.tool`, and the handle that is there without one."""

    def __init__(self) -> None:
        self._tools: dict[str, Tool] = {"wipe": Comparison(), "erase": Eraser(), "pick": Eyedropper()}
        self._handle = PartHandle()

    def draw_handle(self, context: PanelContext, corner: ImVec2, size: ImVec2) -> None:
        """Draw the handle of the clicked part; call before the view's own item, which is below it."""
        self._handle.draw(context, corner, size)

    def click(self, context: PanelContext) -> None:
        """Take a click on the view without a tool: the part under the mouse gets a handle."""
        self._handle.click(context)

    def draw(self, context: PanelContext, corner: ImVec2, size: ImVec2) -> bool:
        """Draw the current tool over the view, imgui's last item; return whether it takes the mouse."""
        if imgui.is_key_pressed(imgui.Key.escape):
            context.tool = "turn"
        tool = self._tools.get(context.tool)
        return tool is not None and tool.draw(context, corner, size)
