"""The newest message, right of the menus, where it covers nothing. Not a docked panel."""

from imgui_bundle import ImVec2, icons_fontawesome_4, imgui

from viewer.context import PanelContext
from viewer.services.messages import OK, Button, Message, MessageKind
from viewer.values.printable import as_label
from viewer.widgets.controls import tooltip
from viewer.widgets.text import push_small, shortened

_SUBJECT = 30  # most characters of an object's name on a button
_ICONS = {
    MessageKind.DONE: icons_fontawesome_4.ICON_FA_CHECK,
    MessageKind.NOTE: icons_fontawesome_4.ICON_FA_INFO_CIRCLE,
    MessageKind.PROBLEM: icons_fontawesome_4.ICON_FA_EXCLAMATION_CIRCLE,
}
_COLOURS = {MessageKind.DONE: "accent", MessageKind.NOTE: "warm", MessageKind.PROBLEM: "error"}  # fields of the palette
_CLOSE = icons_fontawesome_4.ICON_FA_TIMES


class MessageLine:
    """Draws the newest message in the menu bar. Nothing of it changes under the mouse."""

    def __init__(self) -> None:
        self._message: Message | None = None
        self._box = ImVec2(0, 0), ImVec2(0, 0)  # opposite corners of the line as drawn last, px on screen

    def draw(self, context: PanelContext, width: float) -> None:
        """Draw the message on ``width`` px; under the mouse it stays, and leaves a gap once it was answered."""
        messages = context.session.messages
        if not imgui.is_mouse_hovering_rect(*self._box, False):
            self._message = messages.newest
        message = self._message
        low = imgui.get_cursor_screen_pos()
        if message is not None and message.relevant() and message in messages.all:
            self._draw_line(context, message, width)
            self._box = low, ImVec2(imgui.get_cursor_screen_pos().x, low.y + imgui.get_frame_height())
        elif message is None:
            self._box = low, low

    @staticmethod
    def _draw_line(context: PanelContext, message: Message, width: float) -> None:
        labels = [f"{_label(button)}###{button.label.lower()}" for button in message.buttons]
        if message.buttons and message.buttons != OK:
            labels.append(f"{_CLOSE}###dismiss")
        style = imgui.get_style()
        icon = _ICONS[message.kind]
        for label in (f"{icon}###", *labels):
            text = label.partition("###")[0]
            width -= imgui.calc_text_size(text).x + 2 * style.frame_padding.x + style.item_spacing.x
        colour = getattr(context.palette, _COLOURS[message.kind])
        imgui.text_colored((*colour, 1.0), icon)
        _draw_text(message.text, max(0.0, width))
        tooltip(message.text, above=False)
        for label, button in zip(labels, (*message.buttons, OK[0]), strict=False):
            if imgui.small_button(label):
                context.session.messages.dismiss(message)
                button.press()


def _draw_text(text: str, width: float) -> None:
    """Draw text on ``width`` px: on two small lines if it is longer, shortened if these are not enough."""
    if imgui.calc_text_size(text).x <= width:
        imgui.text_unformatted(text)
        return
    push_small()
    text = shortened(text, 1.8 * width)  # a line is broken between words, before its end
    imgui.pop_font()
    height = imgui.get_frame_height()
    colour = imgui.get_color_u32(imgui.Col_.text)
    draw = imgui.get_window_draw_list()
    draw.add_text(imgui.get_font(), height / 2, imgui.get_cursor_screen_pos(), colour, text, wrap_width=width)
    imgui.dummy((width, height))


def _label(button: Button) -> str:
    """Return a button's label, with the name of the object that it is about."""
    subject = button.subject if len(button.subject) <= _SUBJECT else f"{button.subject[: _SUBJECT - 1]}…"
    return as_label(f"{button.label} {subject}".rstrip())
