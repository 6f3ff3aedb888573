"""Over the view, what a fit offers: to follow it, or to show its result. Not a docked panel: there when needed."""

from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from viewer.context import PanelContext
from viewer.widgets.controls import OVERLAY_FLAGS, action_button, button, tooltip


def draw(context: PanelContext) -> None:
    """A line near the top of the view, in its middle, under the hint for newcomers."""
    fitting = context.fitting
    if not (fitting.can_follow or fitting.ready):
        return
    low, high = context.view
    place = ImVec2((low.x + high.x) / 2, low.y + hello_imgui.em_size(5.8))
    imgui.set_next_window_pos(place, imgui.Cond_.always, (0.5, 0))
    imgui.set_next_window_bg_alpha(0.94)
    if imgui.begin("###Running fit", None, OVERLAY_FLAGS)[0]:
        if fitting.ready:
            _draw_ready(context, fitting.ready.name)
        if fitting.can_follow:
            imgui.align_text_to_frame_padding()
            imgui.text_disabled(f"{fitting.history.name} is being rebuilt")
            imgui.same_line()
            action_button(context, "follow", f"{icons_fontawesome_4.ICON_FA_LOCATION_ARROW}  Follow")
    imgui.end()


def _draw_ready(context: PanelContext, name: str) -> None:
    fitting = context.fitting
    imgui.align_text_to_frame_padding()
    imgui.text_colored((*context.palette.accent, 1.0), icons_fontawesome_4.ICON_FA_CHECK)
    imgui.same_line()
    imgui.text_unformatted(f"{name} is ready")
    imgui.same_line()
    if button("Show###show ready", "Make it current; Ctrl+Z brings back what is shown now"):
        fitting.show_ready()
    imgui.same_line()
    if imgui.button(f"{icons_fontawesome_4.ICON_FA_TIMES}###dismiss ready"):
        fitting.dismiss_ready()
    tooltip("Not now: it is among the objects")
