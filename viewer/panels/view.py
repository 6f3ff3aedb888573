"""The object, large: drag to turn it, wheel to zoom, double click to go back."""

import time

from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from core.rendering.progressive import Frame
from viewer.actions import ACTIONS, run_keys
from viewer.activities.viewport import Viewport
from viewer.context import PanelContext
from viewer.screen.theme import packed
from viewer.values import orbit
from viewer.values.quality import QUALITIES
from viewer.values.view_modes import MODES, in_mode
from viewer.widgets.controls import action_button, choose, tooltip

_KEY_TURN = 0.12
"""rad a key press"""
_REST = 0.6
"""s without wheel or keys after which the next nudge is a new edit"""
_FINE = 0.2
_MODES = {mode: mode.capitalize() for mode in MODES}
_BUTTONS = {
    "undo": icons_fontawesome_4.ICON_FA_UNDO,
    "redo": icons_fontawesome_4.ICON_FA_REDO,
    "reset_view": icons_fontawesome_4.ICON_FA_HOME,
}
"""actions, and the icons of their buttons"""
_HINT = "Drag to turn    Wheel to zoom    Drop a photo to fit it    F1 for help"


class ViewPanel:
    """The scene, with a badge that says whether it is a preview or the finished render."""

    title = "View"
    dock = "View"
    waiting = ""

    def __init__(self) -> None:
        self._nudged = 0.0
        self._cached: tuple[Frame, str, Frame] | None = None
        """of which frame and mode, the frame that is shown"""

    def draw(self, context: PanelContext) -> None:
        """The frame, and over it the badge and a few buttons."""
        corner, room = imgui.get_cursor_screen_pos(), imgui.get_content_region_avail()
        size = ImVec2(max(room.x, 32), max(room.y, 32))
        scale = imgui.get_io().display_framebuffer_scale
        pixels = max(1, round(size.x * scale.x)), max(1, round(size.y * scale.y))
        context.view = corner, corner + size
        if not context.ready:
            loading = context.session.loading
            _note(corner + size * 0.5, f"Loading {loading} …" if loading else "No model")
            return
        viewport = context.viewport
        viewport.resize(*pixels)
        if viewport.frame is None:
            _note(corner + size * 0.5, "Rendering …")
            return
        assert context.canvas is not None
        smooth = context.preferences.smooth and viewport.frame.final
        texture = context.canvas.draw(self._in_mode(viewport, context.view_mode), pixels, context.palette, smooth)
        imgui.get_window_draw_list().add_image_rounded(
            texture, corner, corner + size, (0, 0), (1, 1), 0xFFFFFFFF, hello_imgui.em_size(0.4)
        )
        imgui.set_next_item_allow_overlap()
        buttons = imgui.ButtonFlags_
        every = buttons.mouse_button_left | buttons.mouse_button_middle | buttons.mouse_button_right
        imgui.invisible_button("orbit", size, every)
        self._react(context, size)
        _draw_badge(viewport, viewport.frame, corner, size)
        _draw_buttons(context, corner, size)
        if context.preferences.newcomer:
            _note(corner + ImVec2(size.x / 2, hello_imgui.em_size(4.2)), _HINT)

    def _in_mode(self, viewport: Viewport, mode: str) -> Frame:
        """The frame as the mode shows it, computed once."""
        assert viewport.frame is not None
        if viewport.full_frame and (self._cached is None or self._cached[:2] != (viewport.frame, mode)):
            frame, crop = viewport.full_frame
            self._cached = viewport.frame, mode, crop.cropped(in_mode(frame, crop.camera, mode))
        assert self._cached is not None
        return self._cached[2]

    def _react(self, context: PanelContext, size: ImVec2) -> None:
        editor, io = context.editor, imgui.get_io()
        if imgui.is_item_active() and (io.mouse_delta.x or io.mouse_delta.y):
            share = (_FINE if io.key_shift else 1.0) / min(size.x, size.y)
            across, down = io.mouse_delta.x * share, io.mouse_delta.y * share
            if imgui.is_mouse_down(imgui.MouseButton_.left):
                editor.set_camera(orbit.dragged(context.fitting.following.camera, across, down), gesture="orbit")
                context.set_preference(newcomer=False)
            else:
                context.viewport.pan_by(across, down)
        if imgui.is_item_deactivated():
            editor.end_gesture()
        if imgui.is_item_hovered():
            if imgui.is_mouse_double_clicked(imgui.MouseButton_.left):
                context.viewport.reset_view()
            if io.mouse_wheel:
                self._nudge(
                    context, orbit.zoomed(context.fitting.following.camera, io.mouse_wheel, editor.model), "zoom"
                )
        if imgui.is_window_focused() or imgui.is_item_hovered():
            self._keys(context)
        if self._nudged and imgui.is_any_item_active():
            self._nudged = 0.0  # a drag has taken over, and ends the gesture itself
        if self._nudged and time.monotonic() - self._nudged > _REST:
            editor.end_gesture()
            self._nudged = 0.0

    def _keys(self, context: PanelContext) -> None:
        camera, step = context.fitting.following.camera, _KEY_TURN * (_FINE if imgui.get_io().key_shift else 1.0)
        if imgui.get_io().want_text_input or imgui.get_io().key_ctrl:
            return
        turns = {"left_arrow": (-step, 0), "right_arrow": (step, 0), "up_arrow": (0, step), "down_arrow": (0, -step)}
        for key, (azimuth, elevation) in turns.items():
            if imgui.is_key_pressed(getattr(imgui.Key, key)):
                self._nudge(context, orbit.turned(camera, azimuth, elevation), "keys")
        for keys, steps in ((("equal", "keypad_add"), 1), (("minus", "keypad_subtract"), -1)):
            if any(imgui.is_key_pressed(getattr(imgui.Key, key)) for key in keys):
                self._nudge(context, orbit.zoomed(camera, steps, context.editor.model), "zoom")
        run_keys(context, in_view=True)

    def _nudge(self, context: PanelContext, camera: orbit.Camera, gesture: str) -> None:
        self._nudged = time.monotonic()
        context.set_preference(newcomer=False)
        context.editor.set_camera(camera, gesture)


def _draw_badge(viewport: Viewport, frame: Frame, corner: ImVec2, size: ImVec2) -> None:
    width, height = frame.resolution
    text = f"{width} x {height} px   {frame.samples} samples"
    if frame.supersampling > 1:
        text += f", smoothed {frame.supersampling} x {frame.supersampling}"
    live = viewport.source == "fit"
    if live:
        text = f"The fit under way   {width} x {height} px"
    elif not frame.final:
        text = f"Preview {frame.stage + 1} of {frame.stage_count}   {text}"
    em = hello_imgui.em_size()
    extent = imgui.calc_text_size(text)
    low = ImVec2(corner.x + 0.7 * em, corner.y + size.y - extent.y - 1.2 * em)
    high = ImVec2(low.x + extent.x + 2.1 * em, low.y + extent.y + 0.5 * em)
    draw = imgui.get_window_draw_list()
    draw.add_rect_filled(low, high, packed((0.07, 0.08, 0.09), 0.72), 0.35 * em)
    dot = (0.35, 0.8, 0.5) if frame.final and not live else (0.95, 0.7, 0.25)
    draw.add_circle_filled(ImVec2(low.x + 0.75 * em, (low.y + high.y) / 2), 0.24 * em, packed(dot))
    draw.add_text(ImVec2(low.x + 1.4 * em, low.y + 0.25 * em), packed((0.95, 0.95, 0.96)), text)


def _draw_buttons(context: PanelContext, corner: ImVec2, size: ImVec2) -> None:
    em = hello_imgui.em_size()
    imgui.set_cursor_screen_pos(corner + ImVec2(0.7 * em, 0.7 * em))
    for number, (action, icon) in enumerate(_BUTTONS.items()):
        if number:
            imgui.same_line(0, 0.3 * em)
        action_button(context, action, icon)
    imgui.set_cursor_screen_pos(corner + ImVec2(size.x - 17.2 * em, 0.7 * em))
    hint = ACTIONS["next_mode"].hint()
    context.view_mode = choose("mode", context.view_mode, _MODES, f"What the view shows: {hint}")
    imgui.same_line(0, 0.3 * em)
    imgui.set_next_item_width(9 * em)
    level, last = context.preferences.quality, len(QUALITIES) - 1
    moved, to = imgui.slider_int("##quality", level, 0, last, "Quality", imgui.SliderFlags_.always_clamp)
    if moved and to != level:
        context.set_preference(quality=to)
        context.viewport.set_quality(QUALITIES[to])
    quality = context.viewport.settings.quality
    tooltip(f"The finished render: {quality.detail} px, {quality.samples} samples; finer takes longer")


def _note(centre: ImVec2, text: str) -> None:
    em = hello_imgui.em_size()
    half = imgui.calc_text_size(text) * 0.5
    draw, pad = imgui.get_window_draw_list(), ImVec2(em, 0.5 * em)
    draw.add_rect_filled(centre - half - pad, centre + half + pad, packed((0.07, 0.08, 0.09), 0.72), 0.5 * em)
    draw.add_text(centre - half, packed((0.95, 0.95, 0.96)), text)
