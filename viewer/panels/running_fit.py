"""Over the view, while a fit runs that it does not show: a way back to it. Not a docked panel: there when needed."""

from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from viewer.context import PanelContext
from viewer.widgets.controls import OVERLAY_FLAGS, action_button


def draw(context: PanelContext) -> None:
    """A line near the top of the view, in its middle, under the hint for newcomers."""
    if not context.session.fitting.can_follow:
        return
    low, high = context.view
    place = ImVec2((low.x + high.x) / 2, low.y + hello_imgui.em_size(5.8))
    imgui.set_next_window_pos(place, imgui.Cond_.always, (0.5, 0))
    imgui.set_next_window_bg_alpha(0.94)
    if imgui.begin("###Running fit", None, OVERLAY_FLAGS)[0]:
        imgui.align_text_to_frame_padding()
        imgui.text_disabled(f"{context.session.fitting.history.name} is being rebuilt")
        imgui.same_line()
        action_button(context, "follow", f"{icons_fontawesome_4.ICON_FA_LOCATION_ARROW}  Follow")
    imgui.end()
