"""Where the object is seen from, in numbers, and the usual places."""

import math
from dataclasses import replace

from imgui_bundle import hello_imgui, imgui

from viewer.context import Panel, PanelContext
from viewer.values import orbit
from viewer.widgets.controls import action_button, end_gesture, flow, tooltip

_STEEPEST = math.degrees(orbit.HIGHEST)
_NUMBER = 9  # em, a number to drag


class CameraPanel(Panel):
    """Azimuth, elevation and distance to drag or to type, and a button for each usual view."""

    title = "Camera"
    dock = "Drawer"
    folded = True

    def draw(self, context: PanelContext) -> None:
        """The buttons above the numbers."""
        for number, (action, label) in enumerate(_VIEWS.items()):
            if number:
                flow(label, 4.5)
            action_button(context, action, label, width=4.5)
        for number, (action, label) in enumerate(_MORE.items()):
            if number:
                flow(label, 7.4)
            action_button(context, action, label, width=7.4)
        editor, camera = context.session.editor, context.session.editor.scene.camera
        azimuth, elevation = math.degrees(camera.azimuth), math.degrees(camera.elevation)
        turned = _number(context, "azimuth", azimuth, 1.0, (-360.0, 360.0), "%.1f°", "Around the object; front is 90°")
        if turned is not None:
            editor.set_camera(replace(camera, azimuth=math.remainder(math.radians(turned), 2 * math.pi)), "azimuth")
        flow("elevation", _NUMBER)
        raised = _number(context, "elevation", elevation, 0.5, (-_STEEPEST, _STEEPEST), "%.1f°", "Above the horizontal")
        if raised is not None:
            editor.set_camera(replace(camera, elevation=math.radians(raised)), "elevation")
        reach = orbit.reach(camera, editor.model)
        flow("distance", _NUMBER)
        moved = _number(context, "distance", camera.distance, 0.01, reach, "%.2f", "An object's diagonal is 1")
        if moved is not None:
            editor.set_camera(replace(camera, distance=moved), "distance")


_VIEWS = {"see_front": "Front", "see_side": "Side", "see_top": "Top", "see_photo": "Photo", "reset_view": "Home"}
_MORE = {"orthographic": "Orthographic", "copy_camera": "Copy", "paste_camera": "Paste"}  # labels of buttons


def _number(
    context: PanelContext, name: str, value: float, speed: float, limits: tuple[float, float], form: str, text: str
) -> float | None:
    """A number to drag or to type; what it became, if it was changed."""
    imgui.set_next_item_width(hello_imgui.em_size(_NUMBER))
    clamp = imgui.SliderFlags_.always_clamp
    changed, to = imgui.drag_float(f"##{name}", value, speed, *limits, f"{name.capitalize()}  {form}", clamp)
    end_gesture(context)
    tooltip(f"{text}. Drag, or Ctrl+click to type")
    return to if changed else None
