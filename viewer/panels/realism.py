"""How far shape and texture are from what the model was trained on, and a way back."""

from imgui_bundle import ImVec2, hello_imgui, imgui

from viewer.context import Panel, PanelContext
from viewer.screen.theme import Colour
from viewer.values.part import PARTS, Part
from viewer.values.variety import readable
from viewer.widgets import object_tiles
from viewer.widgets.controls import end_gesture, flow, labelled_slider, tooltip
from viewer.widgets.text import caption

_REACH = 3.0  # standard deviations, where the slider ends
_LEAST = 0.01  # standard deviations, where it begins: the mean itself has no direction to lead out again
_TYPICAL, _UNUSUAL = 1.4, 1.8  # standard deviations: trained objects are nearer; beyond, few are realistic
_BESIDE = 5  # em: where less is left beside a picture, words stand below it
_GREEN: Colour = (0.35, 0.75, 0.5)
_AMBER: Colour = (0.9, 0.66, 0.25)
_HELP = (
    "How far from the mean of the trained {part}s; a typical one has about 1 (a standard deviation).\n"
    "Drag to the left to bring the {part} back towards the mean."
)


class RealismPanel(Panel):
    """For each code a meter, which is the slider that scales it, and the trained object that is nearest."""

    title = "Realism"
    dock = "Right"
    folded = True

    def draw(self, context: PanelContext) -> None:
        """Shape and texture side by side."""
        if imgui.begin_table("kinds", 2, imgui.TableFlags_.sizing_stretch_same):
            for part in PARTS:
                imgui.table_next_column()
                imgui.begin_disabled(part in context.session.editor.locked)
                self._draw_meter(context, part)
                imgui.end_disabled()
                self._draw_nearest(context, part)
            imgui.end_table()

    def _draw_meter(self, context: PanelContext, part: Part) -> None:
        editor, distance = context.session.editor, context.session.editor.distance(part)
        far, colour = _verdict(context, distance)
        imgui.text(part.capitalize())
        flow(far)
        imgui.text_colored((*colour, 1.0), far)
        imgui.push_style_color(imgui.Col_.slider_grab, (*colour, 1.0))
        moved, to = labelled_slider(f"distance {part}", "", distance, (_LEAST, _REACH), f"{distance:.2f} ×")
        imgui.pop_style_color()
        if moved and abs(to - distance) > 1e-4:
            editor.scale_to_distance(part, to, gesture=f"distance {part}")
        end_gesture(context)
        tooltip(_HELP.format(part=part))

    def _draw_nearest(self, context: PanelContext, part: Part) -> None:
        nearest = context.session.editor.nearest(part)
        if nearest is None:
            return
        name, distance = nearest
        corner = imgui.get_cursor_screen_pos()
        side = min(5 * hello_imgui.em_size(), 0.4 * imgui.get_content_region_avail().x)
        imgui.dummy(ImVec2(side, side))
        object_tiles.paint(context, name, corner, side)
        if imgui.get_content_region_avail().x - side > hello_imgui.em_size(_BESIDE):
            imgui.same_line()
        imgui.begin_group()
        imgui.text_disabled("Nearest")
        imgui.text_wrapped(readable(name))
        caption(context, f"{distance:.2f} × typical away")
        imgui.end_group()


def _verdict(context: PanelContext, distance: float) -> tuple[str, Colour]:
    if distance <= _TYPICAL:
        return "typical", _GREEN
    return ("unusual", _AMBER) if distance <= _UNUSUAL else ("far from typical", context.palette.error)
