"""A row of three fields for the object's width, depth and height in centimetres."""

from imgui_bundle import hello_imgui, icons_fontawesome_4, imgui

from core.geometry.camera import Factors
from core.rendering.size import Size, with_side
from viewer.context import PanelContext
from viewer.widgets.controls import button, end_gesture, tooltip
from viewer.widgets.text import heading

SIDES = "Width", "Depth", "Height"
_HANDLES = icons_fontawesome_4.ICON_FA_ARROWS_ALT
_NATURAL = icons_fontawesome_4.ICON_FA_UNDO
_SPEED = 0.5  # % of a side per px of a drag
_FINE = 20.0  # cm below which a size has a decimal


def draw_size(context: PanelContext) -> None:
    """Draw the fields, a button for the box with handles, and one for the natural size."""
    editor = context.session.editor
    bounds = context.session.sizing.bounds
    stretch = editor.scene.instance.codes.factors
    heading(context, "Size")
    imgui.begin_disabled(bounds is None or "shape" in editor.locked)
    natural = bounds.size(editor.model.metres) if bounds else None
    gap = imgui.get_style().item_inner_spacing.x
    em = hello_imgui.em_size()
    icon = imgui.get_frame_height() / em + 0.6  # em, width of a button
    width = (imgui.get_content_region_avail().x - 2 * icon * em - 4 * gap) / 3
    for axis in range(3):
        imgui.set_next_item_width(width)
        _draw_side(context, axis, natural, stretch)
        imgui.same_line(0, gap)
    chosen = context.tool == "size"
    colour = context.palette.accent if chosen else None
    if button(f"{_HANDLES}###size handles", "Drag the sides of a box around the object", icon, colour=colour):
        context.tool = "turn" if chosen else "size"
    imgui.same_line(0, gap)
    sized = editor.scene.instance.codes.stretch is not None
    if button(f"{_NATURAL}###natural size", "The natural size", icon, enabled=sized):
        editor.resize(None)
    imgui.end_disabled()


def _draw_side(context: PanelContext, axis: int, natural: Size | None, stretch: Factors) -> None:
    editor = context.session.editor
    usual = natural[axis] if natural else 0.0
    side = usual * stretch[axis]
    text = f"{SIDES[axis][0]} %.{1 if side < _FINE else 0}f" if natural else SIDES[axis][0]
    moved, to = imgui.drag_float(f"##{SIDES[axis]}", side, max(0.01, _SPEED * side / 100), 0.0, 0.0, text)
    if moved and usual and to > 0 and abs(to - side) > 1e-6:
        editor.resize(with_side(stretch, axis, to / usual), gesture=f"size {axis}")
    end_gesture(context)
    if imgui.is_item_hovered() or imgui.is_item_active():
        context.shows_size = True
    tooltip(f"{SIDES[axis]} in cm: drag, or click to type")
