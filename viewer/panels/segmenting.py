"""The dialog that segments a photo: clicks, a box, and strokes that add or remove."""

from dataclasses import replace

from imgui_bundle import ImVec2, hello_imgui, imgui

from core.photos.segmentation import Hints, Stroke
from viewer.actions import chord, is_pressed
from viewer.activities.segmenting import Segmenting
from viewer.context import PanelContext
from viewer.screen.theme import WARM, packed
from viewer.widgets.controls import button, labelled_slider, tooltip

_TITLE = "Cut out###segment"
_MAX_ZOOM = 8.0  # largest zoom factor
_TOOLS = {
    "Box": "Click on the object (Shift: and on more of it), or drag a box around all of it",
    "Add": "Paint over what belongs to the object and was left out",
    "Remove": "Paint over what does not belong to the object",
}  # tooltips of tools
_COLUMN = 14.5  # em, width of the column of tools
_LEAST = 0.01  # least side of a box as a fraction of the photo's: a smaller drag is a slip


class SegmentingDialog:
    """The dialog, open while there is a photo to segment. Every change is segmented at once."""

    def __init__(self) -> None:
        self._tool = "Box"
        self._brush = 0.03  # radius as a fraction of the photo's longer side
        self._before = Hints()  # hints at the start of the current drag
        self._start = (0.0, 0.0)  # start of the drag, fractions of the photo's width and height
        self._zoom = 1.0
        self._offset = ImVec2(0, 0)  # fractions of the photo beyond the left and upper edge
        self._line: tuple[tuple[float, float], ...] = ()  # points of the current stroke, fractions

    def draw(self, context: PanelContext) -> None:
        """Draw the dialog; call once a frame."""
        segmenting = context.session.segmenting
        viewport = imgui.get_main_viewport()
        if segmenting.active and not imgui.is_popup_open(_TITLE):
            imgui.open_popup(_TITLE)
            self._zoom = 1.0
        if not imgui.is_popup_open(_TITLE):
            return
        imgui.set_next_window_pos(viewport.get_center(), imgui.Cond_.always, (0.5, 0.5))
        imgui.set_next_window_size(viewport.work_size * 0.92)
        flags = imgui.WindowFlags_.no_saved_settings | imgui.WindowFlags_.no_move | imgui.WindowFlags_.no_resize
        if not imgui.begin_popup_modal(_TITLE, None, flags)[0]:
            return
        if segmenting.active:
            self._draw_inside(context, segmenting)
        if not segmenting.active:
            imgui.close_current_popup()
        imgui.end_popup()

    def _draw_inside(self, context: PanelContext, segmenting: Segmenting) -> None:
        width = imgui.get_content_region_avail().x - hello_imgui.em_size(_COLUMN) - imgui.get_style().item_spacing.x
        if imgui.begin_child("photo", (width, 0)):
            self._draw_photo(context, segmenting)
        imgui.end_child()
        imgui.same_line()
        imgui.begin_group()
        if imgui.begin_child("tools", (0, -imgui.get_frame_height_with_spacing())):
            self._draw_tools(segmenting)
            _draw_alternatives(context, segmenting)
        imgui.end_child()
        _draw_end(context, segmenting)  # below the tools, visible even in a low window
        imgui.end_group()

    def _draw_photo(self, context: PanelContext, segmenting: Segmenting) -> None:
        if segmenting.plain is None:
            imgui.text_disabled("Reading the photo …")
            return
        room = imgui.get_content_region_avail()
        height, width = segmenting.plain.shape[:2]
        scale = min(room.x / width, room.y / height)
        size = ImVec2(width * scale, height * scale)
        corner = imgui.get_cursor_screen_pos()
        corner += ImVec2((room.x - size.x) / 2, 0)
        imgui.set_cursor_screen_pos(corner)
        imgui.invisible_button("canvas", size)
        origin, extent = self._zoomed(corner, size)
        self._react(segmenting, origin, extent)
        image = segmenting.result.image if segmenting.result else segmenting.plain
        draw = imgui.get_window_draw_list()
        draw.push_clip_rect(corner, corner + size, True)
        draw.add_image(context.texture(image), origin, origin + extent)
        if segmenting.hints.box:
            left, top, right, bottom = segmenting.hints.box
            low = origin + extent * ImVec2(left, top)
            draw.add_rect(low, origin + extent * ImVec2(right, bottom), packed(WARM), thickness=2.0)
        for point in segmenting.hints.points:
            draw.add_circle(origin + extent * ImVec2(*point), 5.0, packed(WARM), thickness=2.0)
        if imgui.is_item_hovered() and self._tool != "Box":
            colour = context.palette.accent if self._tool == "Add" else context.palette.error
            draw.add_circle(imgui.get_mouse_pos(), self._brush * max(extent), packed(colour), thickness=2.0)
        draw.pop_clip_rect()

    def _zoomed(self, corner: ImVec2, size: ImVec2) -> tuple[ImVec2, ImVec2]:
        """Apply wheel and middle drag; return corner and size of the whole photo, px on screen."""
        io = imgui.get_io()
        if imgui.is_item_hovered() and io.mouse_wheel:
            mouse = (imgui.get_mouse_pos() - corner) / size
            previous = self._zoom
            self._zoom = max(1.0, min(_MAX_ZOOM, self._zoom * 1.2**io.mouse_wheel))
            self._offset += mouse * (1 / previous - 1 / self._zoom)
        if imgui.is_item_hovered() and imgui.is_mouse_down(imgui.MouseButton_.middle):
            self._offset -= io.mouse_delta / (size * self._zoom)
        limit = 1 - 1 / self._zoom
        self._offset = imgui.internal.im_clamp(self._offset, ImVec2(0, 0), ImVec2(limit, limit))
        extent = size * self._zoom
        return corner - extent * self._offset, extent

    def _react(self, segmenting: Segmenting, corner: ImVec2, size: ImVec2) -> None:
        """Change the hints: a drag makes a box or a stroke, a click a point."""
        mouse = imgui.get_mouse_pos() - corner
        point = min(1.0, max(0.0, mouse.x / size.x)), min(1.0, max(0.0, mouse.y / size.y))
        if imgui.is_item_activated():
            segmenting.begin_change()
            self._before = segmenting.hints
            self._start = point
            self._line = ()
        if imgui.is_item_deactivated() and self._tool == "Box" and segmenting.hints == self._before:
            points = (*self._before.points, point) if imgui.get_io().key_shift else (point,)
            segmenting.set_hints(replace(self._before, box=None, points=points, choice=0, strokes=()))
        if not imgui.is_item_active():
            return
        if self._tool == "Box":
            (left, right), (top, bottom) = (sorted(pair) for pair in zip(self._start, point, strict=True))
            if min(right - left, bottom - top) > _LEAST:
                segmenting.set_hints(replace(self._before, box=(left, top, right, bottom), points=()))
        elif not self._line or point != self._line[-1]:
            self._line = (*self._line, point)
            stroke = Stroke(self._line, self._brush, self._tool == "Add")
            segmenting.set_hints(replace(self._before, strokes=(*self._before.strokes, stroke)))

    def _draw_tools(self, segmenting: Segmenting) -> None:
        for number, (tool, text) in enumerate(_TOOLS.items()):
            if number:
                imgui.same_line(0, 0.3 * hello_imgui.em_size())
            if imgui.radio_button(tool, self._tool == tool):
                self._tool = tool
            tooltip(text)
        self._brush = labelled_slider("brush", "Brush", self._brush, (0.005, 0.15), f"{self._brush:.1%}")[1]
        is_undone = button("Undo###undo hints", "Take the last of these back (Ctrl+Z)")
        if is_undone or is_pressed(chord(imgui.Key.mod_ctrl, imgui.Key.z)):
            segmenting.undo()
        if not segmenting.settled:
            problem = segmenting.problem
            imgui.text_wrapped(f"{problem[:1].upper()}{problem[1:]}" if problem else "Cutting …")


def _draw_alternatives(context: PanelContext, segmenting: Segmenting) -> None:
    """Draw the alternative masks; a click chooses one."""
    side = hello_imgui.em_size((_COLUMN - 3) / 2)
    for number, image in enumerate(segmenting.result.alternatives if segmenting.result else ()):
        if number:
            imgui.same_line()
        height, width = image.shape[:2]
        size = ImVec2(width, height) * (side / max(width, height))
        if imgui.image_button(f"other {number}", context.texture(image), size):
            segmenting.choose(number)
        tooltip("Take this mask instead")


def _draw_end(context: PanelContext, segmenting: Segmenting) -> None:
    if button("Fit###fit segmentation", "Find this object", 6, segmenting.settled):
        context.focus = "Photo"
        segmenting.fit()
        return
    imgui.same_line()
    cancelled = button("Cancel###cancel segmentation", "Leave everything as it was", 6)
    if cancelled or imgui.is_key_pressed(imgui.Key.escape):
        segmenting.close()
