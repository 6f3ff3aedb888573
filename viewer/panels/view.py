"""The object, large: drag to turn it, wheel to zoom, double click to go back."""

import time

from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from core.rendering.progressive import Frame
from viewer.activities.viewport import Viewport
from viewer.context import Desk, button, tip
from viewer.screen.theme import packed
from viewer.session import Session
from viewer.values import orbit
from viewer.values.quality import QUALITIES
from viewer.values.view_modes import MODES, seen_as
from viewer.widgets.video_form import choose

_KEY_TURN = 0.12
"""rad a key press"""
_REST = 0.6
"""s without wheel or keys after which the next nudge is a new edit"""
_FINE = 0.2
_MODES = {mode: mode.capitalize() for mode in MODES}
_HINT = "Drag to turn    Wheel to zoom    Drop a photo to fit it    F1 for help"


class View:
    """The scene, with a badge that tells a preview from the finished picture."""

    title = "View"
    dock = "View"

    def __init__(self) -> None:
        self._nudged = 0.0
        self._mode = "colour"
        self._made: tuple[Frame, str, Frame] | None = None
        """of which frame what was made, in which mode"""

    def draw(self, desk: Desk) -> None:
        """The picture, and over it the badge and a few buttons."""
        corner, room = imgui.get_cursor_screen_pos(), imgui.get_content_region_avail()
        size = ImVec2(max(room.x, 32), max(room.y, 32))
        scale = imgui.get_io().display_framebuffer_scale
        pixels = max(1, round(size.x * scale.x)), max(1, round(size.y * scale.y))
        viewport = desk.session.viewport
        viewport.resize(*pixels)
        desk.view = corner, corner + size
        if viewport.frame is None:
            self._draw_waiting(desk, corner, size)
            return
        assert desk.canvas is not None
        smooth = desk.likes.smooth and viewport.frame.final
        texture = desk.canvas.draw(self._looked(viewport), pixels, desk.palette, smooth)
        imgui.get_window_draw_list().add_image_rounded(
            texture, corner, corner + size, (0, 0), (1, 1), 0xFFFFFFFF, hello_imgui.em_size(0.4)
        )
        imgui.set_next_item_allow_overlap()
        buttons = imgui.ButtonFlags_
        every = buttons.mouse_button_left | buttons.mouse_button_middle | buttons.mouse_button_right
        imgui.invisible_button("orbit", size, every)
        self._hand(desk, size)
        self._draw_badge(desk.session, viewport.frame, corner, size)
        self._draw_buttons(desk, corner, size)
        if desk.likes.newcomer:
            _note(corner + ImVec2(size.x / 2, hello_imgui.em_size(4.2)), _HINT)

    def _looked(self, viewport: Viewport) -> Frame:
        """The frame as it is to be seen, made once."""
        assert viewport.frame is not None
        if viewport.drawn and (self._made is None or self._made[:2] != (viewport.frame, self._mode)):
            frame, excerpt = viewport.drawn
            self._made = viewport.frame, self._mode, excerpt.cropped(seen_as(frame, excerpt.camera, self._mode))
        assert self._made is not None
        return self._made[2]

    def _hand(self, desk: Desk, size: ImVec2) -> None:
        session, io = desk.session, imgui.get_io()
        if imgui.is_item_active() and (io.mouse_delta.x or io.mouse_delta.y):
            share = (_FINE if io.key_shift else 1.0) / min(size.x, size.y)
            across, down = io.mouse_delta.x * share, io.mouse_delta.y * share
            if imgui.is_mouse_down(imgui.MouseButton_.left):
                session.look(orbit.dragged(session.scene.camera, across, down), gesture="orbit")
                desk.chose(newcomer=False)
            else:
                session.viewport.push(across, down)
        if imgui.is_item_deactivated():
            session.settle()
        if imgui.is_item_hovered():
            if imgui.is_mouse_double_clicked(imgui.MouseButton_.left):
                session.reset_view()
            if io.mouse_wheel and session.model:
                self._nudge(desk, orbit.zoomed(session.scene.camera, io.mouse_wheel, session.model), "zoom")
        if imgui.is_window_focused() or imgui.is_item_hovered():
            self._keys(desk)
        if self._nudged and imgui.is_any_item_active():
            self._nudged = 0.0  # a hand has taken over, and lets go when it does
        if self._nudged and time.monotonic() - self._nudged > _REST:
            session.settle()
            self._nudged = 0.0

    def _keys(self, desk: Desk) -> None:
        session, step = desk.session, _KEY_TURN * (_FINE if imgui.get_io().key_shift else 1.0)
        if imgui.get_io().want_text_input or imgui.get_io().key_ctrl or session.model is None:
            return
        turns = {"left_arrow": (-step, 0), "right_arrow": (step, 0), "up_arrow": (0, step), "down_arrow": (0, -step)}
        for key, (azimuth, elevation) in turns.items():
            if imgui.is_key_pressed(getattr(imgui.Key, key)):
                self._nudge(desk, orbit.turned(session.scene.camera, azimuth, elevation), "keys")
        for keys, steps in ((("equal", "keypad_add"), 1), (("minus", "keypad_subtract"), -1)):
            if any(imgui.is_key_pressed(getattr(imgui.Key, key)) for key in keys):
                self._nudge(desk, orbit.zoomed(session.scene.camera, steps, session.model), "zoom")
        if imgui.is_key_pressed(imgui.Key.home, repeat=False):
            session.reset_view()

    def _nudge(self, desk: Desk, camera: orbit.Camera, gesture: str) -> None:
        self._nudged = time.monotonic()
        desk.chose(newcomer=False)
        desk.session.look(camera, gesture)

    def _draw_waiting(self, desk: Desk, corner: ImVec2, size: ImVec2) -> None:
        session = desk.session
        text = f"Loading {session.loading} …" if session.loading else "Drawing …" if session.ready else "No model"
        _note(corner + size * 0.5, text)

    def _draw_badge(self, session: Session, frame: Frame, corner: ImVec2, size: ImVec2) -> None:
        width, height = frame.resolution
        text = f"{width} x {height} px   {frame.samples} samples" + (
            f", smoothed {frame.across} x {frame.across}" if frame.across > 1 else ""
        )
        live = frame is session.fitting.live
        if live:
            text = f"The fit on its way   {width} x {height} px"
        elif not frame.final:
            text = f"Preview {frame.stage + 1} of {frame.stages}   {text}"
        em = hello_imgui.em_size()
        extent = imgui.calc_text_size(text)
        low = ImVec2(corner.x + 0.7 * em, corner.y + size.y - extent.y - 1.2 * em)
        high = ImVec2(low.x + extent.x + 2.1 * em, low.y + extent.y + 0.5 * em)
        draw = imgui.get_window_draw_list()
        draw.add_rect_filled(low, high, packed((0.07, 0.08, 0.09), 0.72), 0.35 * em)
        done = frame.final and not live
        dot = (0.35, 0.8, 0.5) if done else (0.95, 0.7, 0.25)
        draw.add_circle_filled(ImVec2(low.x + 0.75 * em, (low.y + high.y) / 2), 0.24 * em, packed(dot))
        draw.add_text(ImVec2(low.x + 1.4 * em, low.y + 0.25 * em), packed((0.95, 0.95, 0.96)), text)

    def _draw_buttons(self, desk: Desk, corner: ImVec2, size: ImVec2) -> None:
        session, em = desk.session, hello_imgui.em_size()
        imgui.set_cursor_screen_pos(corner + ImVec2(0.7 * em, 0.7 * em))
        history = session.history
        assert history is not None
        if button(f"{icons_fontawesome_4.ICON_FA_UNDO}###undo", "Undo (Ctrl+Z)", enabled=bool(history.past)):
            session.undo()
        imgui.same_line(0, 0.3 * em)
        if button(f"{icons_fontawesome_4.ICON_FA_REDO}###redo", "Redo (Ctrl+Y)", enabled=bool(history.future)):
            session.redo()
        imgui.same_line(0, 0.3 * em)
        if button(
            f"{icons_fontawesome_4.ICON_FA_HOME}###home",
            "Back to the first view, the object in the middle (double click, or Home)",
        ):
            session.reset_view()
        imgui.set_cursor_screen_pos(corner + ImVec2(size.x - 17.2 * em, 0.7 * em))
        self._mode = choose("mode", self._mode, _MODES, "What is shown of the object, and of how it was drawn (V)", 7)
        behind = imgui.is_popup_open("", imgui.PopupFlags_.any_popup)
        if imgui.is_key_chord_pressed(imgui.Key.v) and not (behind or imgui.get_io().want_text_input):
            self._mode = _next(self._mode)
        imgui.same_line(0, 0.3 * em)
        imgui.set_next_item_width(9 * em)
        level, last = desk.likes.quality, len(QUALITIES) - 1
        moved, to = imgui.slider_int("##quality", level, 0, last, "faster – finer", imgui.SliderFlags_.always_clamp)
        if moved and to != level:
            desk.chose(quality=to)
            session.viewport.set_quality(QUALITIES[to])
        quality = session.viewport.quality
        tip(f"The finished picture: {quality.detail} px, {quality.samples} samples; finer takes longer")


def _next(mode: str) -> str:
    names = list(_MODES)
    return names[(names.index(mode) + 1) % len(names)]


def _note(centre: ImVec2, text: str) -> None:
    em = hello_imgui.em_size()
    half = imgui.calc_text_size(text) * 0.5
    draw, pad = imgui.get_window_draw_list(), ImVec2(em, 0.5 * em)
    draw.add_rect_filled(centre - half - pad, centre + half + pad, packed((0.07, 0.08, 0.09), 0.72), 0.5 * em)
    draw.add_text(centre - half, packed((0.95, 0.95, 0.96)), text)
