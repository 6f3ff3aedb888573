"""All messages of this run, with their times."""

from imgui_bundle import imgui

from viewer.context import Panel, PanelContext
from viewer.services.messages import MessageKind
from viewer.widgets.text import caption


class LogPanel(Panel):
    """The newest at the top."""

    title = "Log"
    dock = "Drawer"
    folded = True
    needs_model = False

    def draw(self, context: PanelContext) -> None:
        """A line for each, and under it what is for developers alone."""
        log = context.session.messages.log
        if not log:
            imgui.text_disabled("Nothing has been said yet")
        for message in reversed(log):
            colour = context.palette.error if message.kind is MessageKind.PROBLEM else context.palette.text
            imgui.push_style_color(imgui.Col_.text, (*colour, 1.0))
            imgui.text_wrapped(f"{message.written:%H:%M:%S}  {message.text}")
            imgui.pop_style_color()
            if message.detail:
                caption(context, message.detail)
