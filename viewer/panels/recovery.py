"""The offer to continue a session that ended badly. Not a docked panel: it is there until it is answered."""

from datetime import datetime

from imgui_bundle import hello_imgui, imgui

from viewer.context import PanelContext
from viewer.widgets.controls import button

_WIDTH = 30
"""em, the longest line"""


def draw(context: PanelContext) -> None:
    """A small window in the middle of the program's."""
    autosave = context.autosave
    if autosave is None or not autosave.left:
        return
    flags = imgui.WindowFlags_
    fixed = flags.no_saved_settings | flags.no_docking | flags.no_collapse | flags.always_auto_resize | flags.no_move
    imgui.set_next_window_pos(imgui.get_main_viewport().get_center(), imgui.Cond_.always, (0.5, 0.5))
    if imgui.begin("The last session did not end well###Recovery", None, fixed)[0]:
        when = datetime.fromtimestamp(autosave.times[-1])
        imgui.push_text_wrap_pos(min(hello_imgui.em_size(_WIDTH), 0.9 * imgui.get_main_viewport().work_size.x))
        imgui.text(f"All that was made with every model was saved on {when:%d %B at %H:%M}.")
        imgui.pop_text_wrap_pos()
        if button("Restore###restore", "Bring it back; a search that was under way begins once more", width=9):
            autosave.restore()
        imgui.same_line()
        if button("Discard###discard", "Delete what was saved", width=9):
            autosave.discard()
    imgui.end()
