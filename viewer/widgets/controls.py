"""Small controls: buttons with tooltips, choices, sliders, name fields, progress."""

from collections.abc import Mapping
from typing import TypeVar

from imgui_bundle import ImVec2, hello_imgui, imgui

from viewer.actions import ACTIONS
from viewer.context import PanelContext
from viewer.screen.theme import Colour, emphasised, on
from viewer.values.duration import duration
from viewer.values.printable import as_label, printable
from viewer.widgets.text import shortened

T = TypeVar("T")
OVERLAY_FLAGS = (
    imgui.WindowFlags_.no_decoration
    | imgui.WindowFlags_.always_auto_resize
    | imgui.WindowFlags_.no_saved_settings
    | imgui.WindowFlags_.no_focus_on_appearing
    | imgui.WindowFlags_.no_nav
    | imgui.WindowFlags_.no_docking
    | imgui.WindowFlags_.no_move
)  # of a small, fixed window over the view

_LINE, _ROOM = 40, 7  # em, the longest line of a tooltip, and least room above an item for a tooltip


def tooltip(text: str, above: bool = True) -> None:
    """Add a tooltip, if there is text, to imgui's last item.

    A press hides the tooltip until the mouse has left the item. It is above the item, where there is room, so that what
    follows stays in sight.
    """
    if not text or not is_pointed_at(imgui.HoveredFlags_.for_tooltip):
        return
    screen = imgui.get_main_viewport().size
    top = imgui.get_item_rect_min().y - hello_imgui.em_size(0.3)
    if above and top > hello_imgui.em_size(_ROOM):
        mouse = imgui.get_mouse_pos().x
        imgui.set_next_window_pos(ImVec2(mouse, top), imgui.Cond_.always, (mouse / screen.x, 1))  # within the screen
    if imgui.begin_tooltip():
        imgui.push_text_wrap_pos(min(hello_imgui.em_size(_LINE), 0.9 * screen.x))
        imgui.text_unformatted(printable(text))
        imgui.pop_text_wrap_pos()
        imgui.end_tooltip()


def is_pointed_at(flags: int = 0) -> bool:
    """Return whether the mouse is over imgui's last item, and has not pressed it since it came there."""
    gui = imgui.get_current_context()
    was_active = gui.hovered_id_not_active_timer < gui.hovered_id_timer
    return imgui.is_item_hovered(flags) and not (imgui.is_item_active() or was_active)


def begin_tooltip_at(top: ImVec2) -> bool:
    """Begin a tooltip above a place or, without room, below imgui's last item; if True, call ``end_tooltip``."""
    is_above = top.y > hello_imgui.em_size(_ROOM)
    position = top if is_above else ImVec2(top.x, imgui.get_item_rect_max().y)
    imgui.set_next_window_pos(position, imgui.Cond_.always, (0, 1 if is_above else 0))
    return imgui.begin_tooltip()


def begin_dialog(title: str) -> tuple[bool, bool]:
    """Begin a window in the middle; return whether it is drawn and stays open. Afterwards call imgui's ``end``."""
    viewport = imgui.get_main_viewport()
    flags = imgui.WindowFlags_
    imgui.set_next_window_pos(viewport.get_center(), imgui.Cond_.appearing, (0.5, 0.5))
    imgui.set_next_window_size_constraints((0, 0), viewport.work_size)  # a low window scrolls
    unmoved = flags.no_saved_settings | flags.no_docking | flags.no_collapse | flags.always_auto_resize
    visible, stays = imgui.begin(title, True, unmoved)
    return visible, bool(stays)


def end_gesture(context: PanelContext) -> None:
    """End the drag of imgui's last item on release: the next edit is another step of undo."""
    if imgui.is_item_deactivated():
        context.session.reshaping.release()


def button(label: str, text: str, width: float = 0.0, enabled: bool = True, colour: Colour | None = None) -> bool:
    """Draw a button with a tooltip and return True if pressed.

    Args:
        text: the tooltip.
        width: em; 0 fits the label, -1 fills the line.
    """
    if colour:
        imgui.push_style_color(imgui.Col_.button, (*colour, 1.0))
        for state in (imgui.Col_.button_hovered, imgui.Col_.button_active):
            imgui.push_style_color(state, (*emphasised(colour), 1.0))
        imgui.push_style_color(imgui.Col_.text, (*on(colour), 1.0))
    imgui.begin_disabled(not enabled)
    pressed = imgui.button(label, (hello_imgui.em_size(width) if width > 0 else width, 0))
    imgui.end_disabled()
    if colour:
        imgui.pop_style_color(4)
    tooltip(text)
    return pressed


def action_button(
    context: PanelContext, name: str, label: str = "", width: float = 0.0, colour: Colour | None = None
) -> None:
    """Draw a button that runs an action of the table by its id, ``name``; the default label is its words."""
    action = ACTIONS[name]
    hint = action.hint()
    if button(f"{label or action.words}###{name}", hint[:1].upper() + hint[1:], width, action.enabled(context), colour):
        action.run(context)


def draw_choice(choices: dict[str, str], selected: str) -> str:
    """Draw all choices (values and labels) side by side, wrapped, and return the chosen value."""
    gap = imgui.get_style().item_spacing.x  # half of the gap on either side belongs to the highlight of the chosen one
    imgui.set_cursor_pos_x(imgui.get_cursor_pos_x() + gap / 2)
    for number, (value, label) in enumerate(choices.items()):
        width = imgui.calc_text_size(label).x
        if number:
            imgui.same_line(0, gap)
            if imgui.get_content_region_avail().x < width + gap:
                imgui.new_line()
                imgui.set_cursor_pos_x(imgui.get_cursor_pos_x() + gap / 2)
        if imgui.selectable(f"{label}###{value}", selected == value, size=(width, 0))[0]:
            selected = value
    return selected


def flow(label: str, width: float = 0.0) -> None:
    """Stay in the line if a button with this label, or this width in em, fits; else begin the next line."""
    width = hello_imgui.em_size(width) or imgui.calc_text_size(label).x + 2 * imgui.get_style().frame_padding.x
    imgui.same_line()
    if imgui.get_content_region_avail().x < width:
        imgui.new_line()


def labelled_slider(
    name: str, label: str, value: float, limits: tuple[float, float], text: str, columns: tuple[float, float] = (4, 3)
) -> tuple[bool, float]:
    """Draw a slider between its label and its value; return whether it moved, and its value.

    Afterwards imgui's last item is the slider.

    Args:
        name: id of the slider.
        text: the value as text.
        columns: widths in em of label and value.
    """
    em = hello_imgui.em_size()
    room = imgui.get_content_region_avail().x
    left_width = columns[0] * em
    right_width = columns[1] * em
    if left_width + right_width > 0.6 * room:  # narrow: the label has a line of its own
        imgui.text(label)
        left_width = 0.0
    left = imgui.get_cursor_pos_x()
    imgui.align_text_to_frame_padding()
    corner = imgui.get_cursor_screen_pos()
    draw = imgui.get_window_draw_list()
    colour = imgui.get_color_u32(imgui.Col_.text)
    down = imgui.get_style().frame_padding.y
    if left_width:
        draw.add_text(corner + ImVec2(0, down), colour, label)
    draw.add_text(corner + ImVec2(room - imgui.calc_text_size(text).x, down), colour, text)
    imgui.set_cursor_pos_x(left + left_width)
    imgui.set_next_item_width(max(em, room - left_width - right_width))
    return imgui.slider_float(f"##{name}", value, *limits, "", imgui.SliderFlags_.always_clamp)


def choose(name: str, selected: T, choices: Mapping[T, str], text: str, width: float = 7) -> T:
    """Draw a drop-down list with a tooltip and return the chosen value.

    Args:
        choices: labels by value.
        text: the tooltip.
        width: em.
    """
    imgui.set_next_item_width(hello_imgui.em_size(width))
    if imgui.begin_combo(f"##{name}", choices.get(selected, str(selected))):
        for value, label in choices.items():
            if imgui.selectable(label, value == selected)[0]:
                selected = value
        imgui.end_combo()
    tooltip(text)
    return selected


class NameField:
    """An input line for a name in a menu or a popup."""

    def __init__(self) -> None:
        self._text = ""

    def draw(self, start: str) -> str:
        """Draw the line, first with ``start``. On Enter close the menu and return the name, else return ""."""
        if imgui.is_window_appearing():
            self._text = start
            imgui.set_keyboard_focus_here()
        imgui.set_next_item_width(hello_imgui.em_size(12))
        entered, self._text = imgui.input_text("##new name", self._text, imgui.InputTextFlags_.enter_returns_true)
        if entered:
            imgui.close_current_popup()
        return self._text.strip() if entered else ""


def draw_progress(context: PanelContext, *kinds: str, width: float = 0.0) -> bool:
    """Draw an export's progress bar and cancel button; return False if no file of these kinds is written.

    Args:
        kinds: kinds of :attr:`Exporting.kind`; none: any.
        width: em of bar and button; 0 fills the line.
    """
    exporting = context.session.exporting
    if exporting.path is None or (kinds and exporting.kind not in kinds):
        return False
    left = exporting.remaining
    name = printable(exporting.path.name)
    done = f"{exporting.progress:.0%}   {duration(left)} left" if left is not None else "Preparing …"
    moving = -float(imgui.get_time())  # which imgui draws as a bar that runs to and fro
    bar = hello_imgui.em_size(width - 7)
    room = (bar if width else imgui.get_content_region_avail().x + bar) - imgui.calc_text_size(f"{done}    ").x
    imgui.progress_bar(exporting.progress or moving, (bar, 0), f"{done}   {as_label(shortened(name, room))}")
    tooltip(f"Saving {name}")
    imgui.same_line()
    if button("Cancel###cancel export", "Give it up; no half-written file stays"):
        exporting.cancel()
    return True
