"""Messages in the view's lower right corner, above the history. Not a docked panel."""

from dataclasses import dataclass

from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from viewer.context import PanelContext
from viewer.services.messages import Button, Message, MessageKind
from viewer.values.printable import as_label
from viewer.widgets.controls import MESSAGES, OVERLAY_FLAGS, tooltip

_SUBJECT = 30  # most characters of an object's name on a button
_WIDTH, _BESIDE, _SMALL = 34, 6, 16  # em: longest line, room beside it, and width of a view too small for messages

_ICONS = {
    MessageKind.DONE: icons_fontawesome_4.ICON_FA_CHECK,
    MessageKind.NOTE: icons_fontawesome_4.ICON_FA_INFO_CIRCLE,
    MessageKind.PROBLEM: icons_fontawesome_4.ICON_FA_EXCLAMATION_CIRCLE,
}
_COLOURS = {MessageKind.DONE: "accent", MessageKind.NOTE: "warm", MessageKind.PROBLEM: "error"}  # fields of the palette


class MessageColumn:
    """Draws the messages that have not faded, the newest on top. No button moves while the mouse is over the column."""

    def __init__(self) -> None:
        self._rows: list[_Row] = []  # the oldest first
        self._hovered = False  # the mouse was over the column in the last frame

    def draw(self, context: PanelContext) -> None:
        """Draw the column; under the mouse faded messages stay, and dismissed ones leave a gap."""
        self._update(context)
        if not self._rows:
            return
        low, high = _room(context)
        edge = 0.5 * hello_imgui.em_size()
        imgui.set_next_window_pos(high - ImVec2(edge, edge), imgui.Cond_.always, (1, 1))
        imgui.set_next_window_bg_alpha(0.97)
        pressed = any(_has_buttons(row.message) for row in self._rows)
        # Without buttons, the mouse reaches the window below.
        imgui.push_style_var(imgui.StyleVar_.window_border_size, 1.0)
        if imgui.begin(MESSAGES, None, OVERLAY_FLAGS | (0 if pressed else imgui.WindowFlags_.no_inputs))[0]:
            if not (_is_menu_open() or context.files.asking):
                imgui.internal.bring_window_to_display_front(imgui.internal.get_current_window())
            if pressed:  # no new message moves a button
                imgui.dummy((_line_width(high.x - low.x), 0))
            for number, row in reversed([*enumerate(self._rows)]):
                self._draw_row(context, row, number, high.x - low.x)
        self._hovered = pressed and imgui.is_window_hovered(imgui.HoveredFlags_.allow_when_blocked_by_active_item)
        imgui.end()
        imgui.pop_style_var()

    def _update(self, context: PanelContext) -> None:
        """Take the messages that are due; while the mouse is over the column, add new ones alone."""
        rows = {id(row.message): row for row in self._rows}
        due = [rows.get(id(message)) or _Row(message) for message in context.session.messages.shown]
        if not self._hovered:
            self._rows = due
            return
        self._rows += [row for row in due if id(row.message) not in rows]

    @staticmethod
    def _draw_row(context: PanelContext, row: "_Row", number: int, room: float) -> None:
        """Draw a message, or the gap that it left."""
        message = row.message
        top = imgui.get_cursor_pos_y()
        is_left = any(message is listed for listed in context.session.messages.all) and message.relevant()
        if not is_left and row.height:
            imgui.dummy((0, row.height))
        else:
            _draw(context, message, number, room)
            row.height = imgui.get_cursor_pos_y() - top - imgui.get_style().item_spacing.y


@dataclass(eq=False)
class _Row:
    """A message in the column."""

    message: Message
    height: float = 0.0  # px as drawn last


def _has_buttons(message: Message) -> bool:
    return bool(message.buttons) or message.kind is MessageKind.PROBLEM


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
    imgui.text_unformatted(message.text)
    imgui.pop_text_wrap_pos()
    for position, action in enumerate(message.buttons):
        if position:
            imgui.same_line()
        if imgui.small_button(f"{_label(action)}###{action.label.lower()} {number}"):
            context.session.messages.dismiss(message)
            action.press()
    if _has_buttons(message):
        imgui.same_line()
        if imgui.small_button(f"{icons_fontawesome_4.ICON_FA_TIMES}###dismiss {number}"):
            context.session.messages.dismiss(message)
        tooltip("Dismiss this message")


def _label(button: Button) -> str:
    """Return a button's label, with the name of the object that it is about."""
    subject = button.subject if len(button.subject) <= _SUBJECT else f"{button.subject[: _SUBJECT - 1]}…"
    return as_label(f"{button.label} {subject}".rstrip())
