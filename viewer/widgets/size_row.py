"""Fields for the object's width, depth and height, and for its legs or roof, in centimetres."""

from imgui_bundle import icons_fontawesome_4, imgui

from core.editing.bounds import portion_of
from core.editing.size import SIDES, lengths
from viewer.context import PanelContext
from viewer.widgets.controls import button, end_gesture, tooltip
from viewer.widgets.text import heading

_HANDLES = icons_fontawesome_4.ICON_FA_ARROWS_ALT
_NATURAL = icons_fontawesome_4.ICON_FA_UNDO
_BOX = "Drag the sides of a box around the object, and its legs or roof"
_BUTTON = 2.0  # em, width of a button
_TITLES = {("cars", "depth"): "Length"}  # by category and length; others are named as in the core
_SPEED = 0.5  # % of a length per px of a drag
_FINE = 20.0  # cm below which a length has a decimal


def draw_size(context: PanelContext) -> None:
    """Draw the fields, a button for the box with handles, and one for the natural size."""
    editor = context.session.editor
    bounds = context.session.reshaping.bounds
    instance = editor.scene.instance
    measured = lengths(instance, bounds) if bounds else {}
    portion = portion_of(instance.model)
    imgui.begin_disabled(bounds is None)
    imgui.align_text_to_frame_padding()
    heading(context, "Size")
    imgui.same_line()
    is_tool = context.tool == "size"
    if button(f"{_HANDLES}###size handles", _BOX, _BUTTON, colour=context.palette.accent if is_tool else None):
        context.tool = "turn" if is_tool else "size"
    imgui.same_line()
    if button(f"{_NATURAL}###natural size", "The natural size", _BUTTON, enabled=instance.is_sized):
        editor.edit(instance.natural)
    gap = imgui.get_style().item_inner_spacing.x
    width = (imgui.get_content_region_avail().x - gap) / 2
    names = (*SIDES, portion.name) if portion and (bounds is None or portion.name in measured) else SIDES
    for number, name in enumerate(names):
        if number % 2:
            imgui.same_line(0, gap)
        imgui.set_next_item_width(width)
        _draw_length(context, name, measured.get(name, 0.0))
    imgui.end_disabled()


def _draw_length(context: PanelContext, name: str, length: float) -> None:
    """Draw a field for a length in cm; 0 is not known, and cannot be changed."""
    category = context.session.editor.model.category
    title = _TITLES.get((category, name), name.capitalize())
    text = f"{title} {_format(length)} cm" if length else title
    moved, to = imgui.drag_float(f"##{title}", length, max(0.01, _SPEED * length / 100), 0.0, 0.0, text)
    if moved and length and to > 0 and abs(to - length) > 1e-6:
        context.session.reshaping.resize(name, to)
    end_gesture(context)
    if imgui.is_item_hovered() or imgui.is_item_active():
        context.hints.shows_size = True
    tooltip(f"{title} in cm: drag, or click to type")


def _format(length: float) -> str:
    return f"%.{1 if length < _FINE else 0}f"
