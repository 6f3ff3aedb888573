"""Fields for the object's width, depth and height, and for its legs or roof, in centimetres."""

from collections.abc import Callable

from imgui_bundle import hello_imgui, icons_fontawesome_4, imgui

from core.editing.bounds import Bounds, portion_of
from core.editing.size import with_portion, with_side
from core.models.model import Instance
from viewer.context import PanelContext
from viewer.widgets.controls import button, end_gesture, tooltip
from viewer.widgets.text import heading

SIDES = "Width", "Depth", "Height"
_HANDLES = icons_fontawesome_4.ICON_FA_ARROWS_ALT
_NATURAL = icons_fontawesome_4.ICON_FA_UNDO
_BOX = "Drag the sides of a box around the object, and its legs or roof"
_SPEED = 0.5  # % of a length per px of a drag
_FINE = 20.0  # cm below which a length has a decimal


def draw_size(context: PanelContext) -> None:
    """Draw the fields, a button for the box with handles, and one for the natural size."""
    editor = context.session.editor
    bounds = context.session.sizing.bounds
    heading(context, "Size")
    imgui.begin_disabled(bounds is None or "shape" in editor.locked)
    gap = imgui.get_style().item_inner_spacing.x
    em = hello_imgui.em_size()
    icon = imgui.get_frame_height() / em + 0.6  # em, width of a button
    width = (imgui.get_content_region_avail().x - 2 * icon * em - 4 * gap) / 3
    for axis in range(3):
        imgui.set_next_item_width(width)
        _draw_side(context, axis, bounds)
        imgui.same_line(0, gap)
    chosen = context.tool == "size"
    colour = context.palette.accent if chosen else None
    if button(f"{_HANDLES}###size handles", _BOX, icon, colour=colour):
        context.tool = "turn" if chosen else "size"
    imgui.same_line(0, gap)
    if button(f"{_NATURAL}###natural size", "The natural size", icon, enabled=editor.scene.instance.is_sized):
        editor.edit(editor.scene.instance.natural)
    imgui.set_next_item_width(2 * width + gap)
    _draw_portion(context, bounds)
    imgui.end_disabled()


def _draw_side(context: PanelContext, axis: int, natural: Bounds | None) -> None:
    instance = context.session.editor.scene.instance
    side = natural.after(instance.codes.edits_of("size")).size[axis] if natural else 0.0
    factor = instance.codes.factors[axis]
    text = f"{SIDES[axis][0]} {_format(side)}" if natural else SIDES[axis][0]
    _draw_length(context, SIDES[axis], text, side, lambda to: with_side(instance, axis, factor * to / side))


def _draw_portion(context: PanelContext, natural: Bounds | None) -> None:
    """Draw the field for legs or roof, if the object has them; without a number until they are measured."""
    instance = context.session.editor.scene.instance
    portion = portion_of(instance.model)
    if portion is None or (natural and natural.plane is None):
        return
    name = portion.name.capitalize()
    if natural is None:
        _draw_length(context, name, name, 0.0, lambda to: instance)
        return
    length = natural.after(instance.codes.edits_of("size")).length(portion)
    text = f"{name} {_format(length)} cm"
    _draw_length(context, name, text, length, lambda to: with_portion(instance, natural, to))


def _draw_length(
    context: PanelContext, name: str, text: str, length: float, resized: Callable[[float], Instance]
) -> None:
    """Draw a field for a length in cm; 0 cannot be changed.

    Args:
        resized: the object with another length.
    """
    moved, to = imgui.drag_float(f"##{name}", length, max(0.01, _SPEED * length / 100), 0.0, 0.0, text)
    if moved and length and to > 0 and abs(to - length) > 1e-6:
        context.session.editor.edit(resized(to), gesture=f"size {name}")
    end_gesture(context)
    if imgui.is_item_hovered() or imgui.is_item_active():
        context.shows_size = True
    tooltip(f"{name} in cm: drag, or click to type")


def _format(length: float) -> str:
    return f"%.{1 if length < _FINE else 0}f"
