"""A photo of an object in which a person wipes away what does not belong to it."""

import numpy as np
from imgui_bundle import ImVec2, imgui
from PIL import Image

from core.models.photo_detail import Erasure, PhotoView
from viewer.context import PanelContext
from viewer.screen.theme import packed
from viewer.widgets.controls import tooltip

_RADIUS = 0.04  # of a stroke, a share of the photo's longer side
_LEAST = 0.01  # share of it that the mouse moves at least between two points
_SHOWN = 384  # px of the longer side, of what is shown
_GONE = np.array([255, 120, 120])  # over what is erased


class Eraser:
    """The stroke under way; those that are done are in the detail."""

    def __init__(self) -> None:
        self._points: list[tuple[float, float]] = []
        self._shown: tuple[PhotoView, np.ndarray] | None = None

    def draw(self, context: PanelContext, number: int, width: float) -> None:
        """One of the photos, so many px wide."""
        detail = context.session.editor.scene.codes.detail
        if detail is None or context.images is None:
            return
        view = detail.views[min(number, len(detail.views) - 1)]
        size = ImVec2(width, width * view.camera.height / view.camera.width)
        corner = imgui.get_cursor_screen_pos()
        imgui.invisible_button("erase from photo", size)
        tooltip("Drag over what is no part of the object, a reflection say: the model's colours are shown there")
        if imgui.is_item_active():
            self._extend((imgui.get_mouse_pos().x - corner.x) / size.x, (imgui.get_mouse_pos().y - corner.y) / size.y)
        elif self._points:
            stroke, self._points = Erasure(tuple(self._points), _RADIUS), []
            context.session.editor.set_detail(
                detail.erasing(min(number, len(detail.views) - 1), (*view.erased, stroke))
            )
        draw = imgui.get_window_draw_list()
        draw.add_image(context.images.texture(self._pixels(view), context.palette), corner, corner + size)
        for x, y in self._points:
            reach = _RADIUS * max(size.x, size.y)
            draw.add_circle_filled(corner + ImVec2(x * size.x, y * size.y), reach, packed(context.palette.warm, 0.6))

    def _extend(self, x: float, y: float) -> None:
        place = min(1.0, max(0.0, x)), min(1.0, max(0.0, y))
        if not self._points or max(abs(a - b) for a, b in zip(place, self._points[-1], strict=True)) > _LEAST:
            self._points.append(place)

    def _pixels(self, view: PhotoView) -> np.ndarray:
        """The same array for the same photo."""
        if self._shown is None or self._shown[0] is not view:
            image = Image.fromarray(view.pixels()).convert("RGB")
            image.thumbnail((_SHOWN, _SHOWN))
            pixels = np.array(image)
            gone = ~view.kept(*image.size)
            pixels[gone] = (0.4 * pixels[gone] + 0.6 * _GONE).astype(np.uint8)
            self._shown = view, pixels
        return self._shown[1]
