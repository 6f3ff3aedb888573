"""Where the object is seen from, in numbers, and the usual places."""

import math
from dataclasses import replace

from imgui_bundle import hello_imgui, imgui

from viewer.context import Desk, button, tip
from viewer.values import orbit

_STEEPEST = math.degrees(orbit.HIGHEST)


class CameraPanel:
    """Azimuth, elevation and distance to drag or to type, and a button for each usual view."""

    title = "Camera"
    dock = "Strip"

    def draw(self, desk: Desk) -> None:
        """The buttons above the numbers."""
        session = desk.session
        if session.model is None:
            imgui.text_disabled("The camera comes with the model")
            return
        for number, (name, label) in enumerate(_LABELS.items()):
            if number:
                imgui.same_line(0, hello_imgui.em_size(0.4))
            enabled = name != "photo" or session.fitting.course.last is not None
            if button(f"{label}###see {name}", _told(name, number + 1), width=4.5, enabled=enabled):
                session.see_from(name)
        camera = session.scene.camera
        azimuth, elevation = math.degrees(camera.azimuth), math.degrees(camera.elevation)
        turned = _number(desk, "azimuth", azimuth, 1.0, (-360.0, 360.0), "%.1f°", "Around the object; the front is 90°")
        if turned is not None:
            session.look(replace(camera, azimuth=math.remainder(math.radians(turned), 2 * math.pi)), "azimuth")
        raised = _number(desk, "elevation", elevation, 0.5, (-_STEEPEST, _STEEPEST), "%.1f°", "Above the ground")
        if raised is not None:
            session.look(replace(camera, elevation=math.radians(raised)), "elevation")
        reach = orbit.reach(camera, session.model)
        moved = _number(desk, "distance", camera.distance, 0.01, reach, "%.2f", "An object's diagonal is 1")
        if moved is not None:
            session.look(replace(camera, distance=moved), "distance")


_LABELS = {"front": "Front", "side": "Side", "top": "Top", "photo": "Photo", "home": "Home"}


def _told(name: str, key: int) -> str:
    if name == "photo":
        return f"From where the last photo was found to be taken ({key})"
    return "Back to the first view (Home)" if name == "home" else f"From the {name} ({key})"


def _number(
    desk: Desk, name: str, value: float, speed: float, limits: tuple[float, float], form: str, told: str
) -> float | None:
    """A number to drag or to type; what it became, if it was changed."""
    imgui.set_next_item_width(hello_imgui.em_size(9))
    clamp = imgui.SliderFlags_.always_clamp
    changed, to = imgui.drag_float(f"##{name}", value, speed, *limits, f"{name.capitalize()}  {form}", clamp)
    if imgui.is_item_deactivated():
        desk.session.settle()
    tip(f"{told}. Drag, or Ctrl+click to type")
    imgui.same_line()
    return to if changed else None
