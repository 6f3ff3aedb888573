"""The tool that erases photo detail by strokes, seen from the photo's camera."""

from imgui_bundle import ImVec2, imgui

from core.models.photo_detail import Erasure
from viewer.context import PanelContext
from viewer.screen.theme import packed
from viewer.widgets.comparison import photo_place

_LEAST = 0.01  # distance between points of a stroke, as a fraction of the photo's side
_BRUSH = 0.005, 0.04, 0.2  # least, initial and largest radius, as fractions of the photo's longer side
_WHEEL = 1.2  # factor of the radius per click of the wheel


class Eraser:
    """The stroke being drawn; a finished stroke joins the object's photo detail."""

    def __init__(self) -> None:
        self._points: list[tuple[float, float]] = []
        self._radius = _BRUSH[1]

    def draw(self, context: PanelContext, corner: ImVec2, size: ImVec2) -> bool:
        """Draw stroke and brush over the view, imgui's last item; return whether the tool takes the mouse."""
        photo_rect = photo_place(context, corner, size)
        detail = context.session.editor.scene.instance.detail
        if photo_rect is None or detail is None:
            self._points = []
            return False
        view, low, high = photo_rect
        mouse = imgui.get_mouse_pos()
        extent = high - low
        if imgui.is_item_hovered() and (wheel := imgui.get_io().mouse_wheel):
            self._radius = max(_BRUSH[0], min(_BRUSH[2], self._radius * _WHEEL**wheel))
        if imgui.is_item_active():
            self._extend((mouse.x - low.x) / extent.x, (mouse.y - low.y) / extent.y)
        elif self._points:
            stroke = Erasure(tuple(self._points), self._radius)
            self._points = []
            context.session.editor.set_detail(detail.erasing(detail.views.index(view), (*view.erased, stroke)))
        draw = imgui.get_window_draw_list()
        reach = self._radius * max(extent)
        warm = context.palette.warm
        for x, y in self._points:
            draw.add_circle_filled(low + ImVec2(x * extent.x, y * extent.y), reach, packed(warm, 0.4))
        if imgui.is_item_hovered():
            draw.add_circle(mouse, reach, packed(warm), thickness=2.0)
        return True

    def _extend(self, x: float, y: float) -> None:
        point = min(1.0, max(0.0, x)), min(1.0, max(0.0, y))
        if not self._points or max(abs(a - b) for a, b in zip(point, self._points[-1], strict=True)) > _LEAST:
            self._points.append(point)
