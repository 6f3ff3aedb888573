"""Shape and texture along the principal directions of the trained codes, separately."""

from dataclasses import replace

from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from core.geometry.camera import Camera
from core.models.codes import Codes
from core.models.model import Model
from core.rendering.progressive import Frame
from viewer.activities.thumbnails import SIZE
from viewer.context import PanelContext
from viewer.values import orbit
from viewer.values.history import PARTS, Part
from viewer.values.influence import CodeInfluence
from viewer.widgets import object_tiles
from viewer.widgets.controls import action_button, button, choose, flow, tooltip

_DICE = icons_fontawesome_4.ICON_FA_RANDOM
_FIRST = 8
"""sliders shown at first"""
_REACH = 3.0
"""standard deviations to either side"""
_STEPS = (-2, 0, 2)
"""standard deviations at which a strip shows the object"""
_INFLUENCE = 96
"""px"""
_FILTER: dict[tuple[Part, ...], str] = {PARTS: "Shape and texture", ("shape",): "Shape", ("texture",): "Texture"}
_HELP = (
    "Direction {number}, {share:.0%} of how the trained objects differ in {part}.\n"
    "In standard deviations; 0 is the mean. Ctrl+click to type, right click for 0."
)
_STRIPS_HELP = "Under every slider what the object would be like at -2, 0 and +2; click one to go there"


class SlidersPanel:
    """A column of sliders for each part. A slider changes its coordinate and nothing else."""

    title = "Sliders"
    dock = "Right"
    folded = False
    waiting = "The sliders come with the model"

    def __init__(self) -> None:
        self._all = False
        self._parts: tuple[Part, ...] = PARTS
        """what is shown"""
        self._strips = True
        self._model: Model | None = None
        """whose thumbnails these are"""
        self._basis: Codes | None = None
        """what the strips lead away from: the object before the drag began"""
        self._targets: dict[tuple[Part, int, int], tuple[Codes, Camera]] = {}
        """what every place shows"""
        self._influence: tuple[Part, Frame, Frame, CodeInfluence] | None = None
        """of the slider under the mouse: its part, at less, at more, and between them"""
        self._last: dict[tuple[Part, int, int], Frame] = {}
        """the last thumbnail of every place, until there is a newer one"""

    @property
    def influence(self) -> tuple[Part, CodeInfluence] | None:
        """The part that the slider under the mouse belongs to, and what it changes."""
        return (self._influence[0], self._influence[3]) if self._influence else None

    def draw(self, context: PanelContext) -> None:
        """Shape and texture side by side."""
        editor = context.editor
        if not editor.history.gesture and self._basis is not editor.scene.codes:
            self._basis, self._targets = editor.scene.codes, {}
        if self._model is not editor.model:
            self._model, self._last = editor.model, {}
        self._draw_top(context)
        if imgui.begin_child("sliders"):
            if imgui.begin_table("kinds", len(self._parts), imgui.TableFlags_.sizing_stretch_same):
                for part in self._parts:
                    imgui.table_next_column()
                    self._draw_part(context, part)
                imgui.end_table()
            most = max(len(editor.space(part).std) for part in PARTS)
            if most > _FIRST:
                _, self._all = imgui.checkbox(f"All {most} directions###all", self._all)
                tooltip("Those that explain less as well")
        imgui.end_child()

    def _draw_top(self, context: PanelContext) -> None:
        action_button(context, "sample_all", f"{_DICE}  Random")
        imgui.same_line()
        _, self._strips = imgui.checkbox("Thumbnails###strips", self._strips)
        tooltip(_STRIPS_HELP)
        flow(_FILTER[PARTS])
        self._parts = choose("parts", self._parts, _FILTER, "Which directions are shown")

    def _draw_part(self, context: PanelContext, part: Part) -> None:
        editor = context.editor
        imgui.begin_disabled(part in editor.locked)
        imgui.align_text_to_frame_padding()
        imgui.text(part.capitalize())
        imgui.same_line()
        if button(f"{_DICE}###Random {part}", f"Random: a {part} sampled from the distribution of the trained ones"):
            editor.sample(part)
        if button(f"Mean##{part}", f"The mean {part} of the trained objects"):
            editor.set_to_mean(part)
        imgui.same_line(0, hello_imgui.em_size(0.3))
        if button(f"Reset##{part}", f"The {part} of object A"):
            editor.reset_to_object(part)
        space = editor.space(part)
        values = space.coordinates(editor.code(part)).tolist()
        for index, value in enumerate(values if self._all else values[:_FIRST]):
            self._draw_slider(context, part, index, value, float(space.explained_variance[index]))
            if self._strips:
                self._draw_strip(context, part, index)
        imgui.end_disabled()

    def _draw_slider(self, context: PanelContext, part: Part, index: int, value: float, share: float) -> None:
        editor = context.editor
        imgui.set_next_item_width(-1)
        label = f"{index + 1}:  %+.2f    {100 * share:.0f} %%"
        moved, to = imgui.slider_float(f"##{part} {index + 1}", value, -_REACH, _REACH, label)
        if moved and abs(to - value) > 1e-6:
            editor.set_coordinate(part, index, to, gesture=f"{part} {index}")
        if imgui.is_item_deactivated():
            editor.end_gesture()
        if imgui.is_item_clicked(imgui.MouseButton_.right):
            editor.set_coordinate(part, index, 0.0)
        if imgui.begin_item_tooltip():
            imgui.text(_HELP.format(number=index + 1, share=share, part=part))
            self._draw_influence(context, part, index, value)
            imgui.end_tooltip()

    def _draw_influence(self, context: PanelContext, part: Part, index: int, value: float) -> None:
        """Where the view changes between a standard deviation less and one more."""
        editor = context.editor
        camera = editor.scene.camera.resized(_INFLUENCE, _INFLUENCE)
        space, code = editor.space(part), editor.code(part)
        ends = (space.with_coordinate(code, index, value + step) for step in (-1.0, 1.0))
        codes = (replace(editor.scene.codes, **{part: end}) for end in ends)
        low, high = (context.thumbnails.get(one, camera, soon=True) for one in codes)
        if low is None or high is None:
            return
        if self._influence is None or self._influence[1:3] != (low, high):
            self._influence = part, low, high, CodeInfluence.between(low, high)
        found = self._influence[3]
        assert context.images is not None
        side = 10 * hello_imgui.em_size()
        imgui.image(context.images.texture(found.image, context.palette), (side, side))
        imgui.text(f"Changes {found.changed:.0%} of the object's pixels")
        imgui.text(_leak(part, found.leak))

    def _draw_strip(self, context: PanelContext, part: Part, index: int) -> None:
        """Each thumbnail is below its value on the slider."""
        width = imgui.get_content_region_avail().x
        side = min(3.2 * hello_imgui.em_size(), width / len(_STEPS) - 2)
        corner = imgui.get_cursor_screen_pos()
        seen = imgui.is_rect_visible((width, side))
        for to in _STEPS:
            place = corner + ImVec2(width * (0.5 + to / (2 * _REACH)) - side / 2, 0)
            imgui.set_cursor_screen_pos(place)
            if imgui.invisible_button(f"{part} {index + 1} at {to}", (side, side)):
                context.editor.set_coordinate(part, index, float(to))
            tooltip(f"Direction {index + 1} at {to:+d}" if to else f"Direction {index + 1} at the mean")
            if seen:
                frame, stale = self._thumbnail(context, part, index, to)
                object_tiles.paint_frame(context, frame, place, side, stale)

    def _thumbnail(self, context: PanelContext, part: Part, index: int, to: int) -> tuple[Frame | None, bool]:
        """The newest there is, and whether it is stale: of the object before it was changed."""
        model, basis, place = context.editor.model, self._basis, (part, index, to)
        assert basis is not None
        if place not in self._targets:
            code = context.editor.space(part).with_coordinate(getattr(basis, part), index, float(to))
            self._targets[place] = replace(basis, **{part: code}), orbit.home(model).resized(SIZE, SIZE)
        found = context.thumbnails.get(*self._targets[place])
        if found:
            self._last[place] = found
        return self._last.get(place), found is None


def _leak(part: Part, leak: float) -> str:
    if part == "shape":
        return f"Moves the silhouette: opacity changes by {leak:.2f} at the most"
    return (
        "Does not move the silhouette: opacity changes by exactly 0" if leak == 0 else f"Leaks into opacity by {leak:g}"
    )
