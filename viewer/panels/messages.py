"""Messages in the view's lower right corner, above the history. Not a docked panel."""

import textwrap

from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from viewer.context import PanelContext
from viewer.services.messages import Message, MessageKind
from viewer.widgets.controls import OVERLAY_FLAGS, tooltip

_WIDTH, _BESIDE, _SMALL = 34, 6, 16  # em: longest line, room beside it, and width of a view too small for messages

_ICONS = {
    MessageKind.DONE: icons_fontawesome_4.ICON_FA_CHECK,
    MessageKind.NOTE: icons_fontawesome_4.ICON_FA_INFO_CIRCLE,
    MessageKind.PROBLEM: icons_fontawesome_4.ICON_FA_EXCLAMATION_CIRCLE,
}
_COLOURS = {MessageKind.DONE: "accent", MessageKind.NOTE: "warm", MessageKind.PROBLEM: "error"}  # fields of the palette


def draw(context: PanelContext) -> None:
    """Draw the messages that have not faded in one column, the newest on top: it moves no button."""
    due = context.session.messages.shown
    if not due:
        return
    low, high = _room(context)
    edge = 0.5 * hello_imgui.em_size()
    imgui.set_next_window_pos(high - ImVec2(edge, edge), imgui.Cond_.always, (1, 1))
    imgui.set_next_window_bg_alpha(0.97)
    pressed = any(message.buttons or message.kind is MessageKind.PROBLEM for message in due)
    # Without buttons, the mouse reaches the window below.
    imgui.push_style_var(imgui.StyleVar_.window_border_size, 1.0)
    if imgui.begin("Messages", None, OVERLAY_FLAGS | (0 if pressed else imgui.WindowFlags_.no_inputs))[0]:
        if not (_is_menu_open() or context.files.asking):
            imgui.internal.bring_window_to_display_front(imgui.internal.get_current_window())
        if pressed:  # no new message moves a button
            imgui.dummy((_line_width(high.x - low.x), 0))
        for number, message in reversed([*enumerate(due)]):
            _draw(context, message, number, high.x - low.x)
    imgui.end()
    imgui.pop_style_var()


def _is_menu_open() -> bool:
    """Return whether a popup other than a dialog is open, whose entries messages must not cover."""
    any_popup = imgui.is_popup_open("", imgui.PopupFlags_.any_popup)
    return any_popup and imgui.internal.get_top_most_popup_modal() is None


def _room(context: PanelContext) -> tuple[ImVec2, ImVec2]:
    """Return the corners of the room for messages: the view above the history or, if need be, the window.

    The window is used if the view is narrow or the Share dialog is open.
    """
    low, high = context.view
    viewport = imgui.get_main_viewport()
    end = viewport.work_pos + viewport.work_size
    if high.x - low.x > hello_imgui.em_size(_SMALL) and not context.share_open:
        return low, high - ImVec2(0, context.covered)
    return viewport.work_pos, end


def _line_width(room: float) -> float:
    """Return the width of the longest line in px."""
    return min(hello_imgui.em_size(_WIDTH), room - hello_imgui.em_size(_BESIDE))


def _draw(context: PanelContext, message: Message, number: int, room: float) -> None:
    colour = getattr(context.palette, _COLOURS[message.kind])
    imgui.text_colored((*colour, 1.0), _ICONS[message.kind])
    imgui.same_line()
    imgui.push_text_wrap_pos(imgui.get_cursor_pos_x() + _line_width(room))
    imgui.text_unformatted(textwrap.shorten(message.text, 400))
    imgui.pop_text_wrap_pos()
    for place, one in enumerate(message.buttons):
        if place:
            imgui.same_line()
        if imgui.small_button(f"{one.label}###{one.label.lower()} {number}"):
            context.session.messages.dismiss(message)
            one.press()
    if message.kind is MessageKind.PROBLEM or message.buttons:
        imgui.same_line()
        if imgui.small_button(f"{icons_fontawesome_4.ICON_FA_TIMES}###dismiss {number}"):
            context.session.messages.dismiss(message)
        tooltip("Dismiss this message")
