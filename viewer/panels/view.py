"""The panel of the view: the image of the scene, with its mouse, keys, buttons and badge."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from core.detail.progressive import Frame
from viewer.actions import chords, is_pressed, is_typed
from viewer.context import Hints, Panel, PanelContext
from viewer.screen.theme import ON_PLATE, PLATE, PLATE_OPACITY, WARM, packed
from viewer.values import orbit
from viewer.values.state import Pair
from viewer.values.view_modes import in_mode
from viewer.widgets.comparison import Comparison
from viewer.widgets.controls import action_button, end_gesture, tooltip
from viewer.widgets.eraser import Eraser
from viewer.widgets.paint import pick_in_view
from viewer.widgets.part_handle import PartHandle
from viewer.widgets.size_box import draw_size_box
from viewer.widgets.text import paint_on_plate
from viewer.widgets.welcome import Welcome

_KEY_TURN = 0.12  # rad per key press
_FINE = 0.2  # factor of motion while Shift is held
_BUTTONS = {
    "undo": icons_fontawesome_4.ICON_FA_UNDO,
    "redo": icons_fontawesome_4.ICON_FA_REDO,
    "reset_view": icons_fontawesome_4.ICON_FA_HOME,
    "share": icons_fontawesome_4.ICON_FA_SHARE_ALT,
}  # icons of buttons, by actions' ids
_HINT = "Drag to turn    Wheel to zoom    F1 for help"  # between the buttons, if there is room
_COVERED, _FREE = 4, 8  # divisors of the height: most that may be covered, and what the history may cover in place
_NARROW = 26.0  # em: a narrower view has buttons without words
_STILL = 3.0  # px of motion from which a click is a drag
_ENOUGH = 0.5  # fraction of the view's px below which an image counts as a preview


class ViewPanel(Panel):
    """The scene's image, with a badge while it is a preview."""

    title = "View"
    dock = "View"
    bare = True

    def __init__(self) -> None:
        self._welcome = Welcome()
        self._tools: dict[str, Callable[[PanelContext, ImVec2, ImVec2], bool]] = {
            "wipe": Comparison().draw,
            "erase": Eraser().draw,
            "pick": pick_in_view,
        }  # draw over the view, imgui's last item, from its corner and size on screen, and tell if they take the mouse
        self._handle = PartHandle()
        self._shown: Pair | None = None  # object A in the last frame
        self._pans = False  # the middle or right button was pressed in the view, and is held
        self._covered = 0  # px of the view's lower edge that the welcome card or the history covers

    def draw(self, context: PanelContext) -> None:
        """Draw the image, react to mouse and keys, and draw buttons, hint, welcome card and badge."""
        corner = imgui.get_cursor_screen_pos()
        room = imgui.get_content_region_avail()
        size = ImVec2(max(room.x, 32), max(room.y, 32))
        context.view = corner, corner + size
        hints = context.hints
        context.hints = Hints()
        context.card_width = 0.0
        begins = self._welcome.is_due(context)
        pixels = self._resize(context, size, begins)
        frame = context.session.viewport.frame
        if frame is None:
            _note(corner + size * 0.5, "Rendering …")
            return
        draw = imgui.get_window_draw_list()
        texture = _texture(context, pixels, hints.ring)
        draw.add_image_rounded(texture, corner, corner + size, (0, 0), (1, 1), 0xFFFFFFFF, hello_imgui.em_size(0.4))
        _draw_overlay(context, hints.overlay, corner, size)
        # Buttons first: a press in the frame that moves the mouse onto one is that button's. They are drawn on top.
        draw.channels_split(2)
        draw.channels_set_current(1)
        _draw_buttons(context, corner, size)
        if not begins or context.session.editor.history.past:
            _draw_badge(context, frame, corner + ImVec2(0, size.y - context.covered))
        draw_size_box(context, corner, size, hints.shows_size)
        self._handle.draw(context, corner, size)
        draw.channels_set_current(0)
        imgui.set_cursor_screen_pos(corner)
        is_released = imgui.invisible_button("orbit", size)
        object_a = context.session.editor.state.mix.a
        if imgui.is_key_pressed(imgui.Key.escape) or (object_a != self._shown and context.tool in self._tools):
            context.tool = "turn"  # else a drag over the next object would erase from its photo, say
        self._shown = object_a
        tool = self._tools.get(context.tool)
        if tool is None or not tool(context, corner, size):
            self._react(context, size)
            if is_released and imgui.get_io().mouse_drag_max_distance_sqr[0] < _STILL**2:
                self._handle.click(context)
        draw.channels_merge()
        if begins:
            self._welcome.draw(context, corner, size)
            context.covered = max(context.covered, self._welcome.covered)

    def _resize(self, context: PanelContext, size: ImVec2, begins: bool) -> tuple[int, int]:
        """Render for a view of ``size``, in part covered by the welcome card or the history; return its pixels."""
        scale = imgui.get_io().display_framebuffer_scale
        pixels = max(1, round(size.x * scale.x)), max(1, round(size.y * scale.y))
        history = context.session.editor.history
        if not history.gesture and not (begins and history.past):  # the object must not move during a drag
            low = self._welcome.covered if begins else context.covered if context.covered > size.y / _FREE else 0.0
            self._covered = round(low * scale.y)
        covered = min(self._covered, pixels[1] // _COVERED)
        context.session.viewport.change(panel=pixels, covered=covered, opengl=context.fast_opengl)
        return pixels

    def _react(self, context: PanelContext, size: ImVec2) -> None:
        editor = context.session.editor
        io = imgui.get_io()
        if imgui.is_item_active() and imgui.is_mouse_dragging(imgui.MouseButton_.left, _STILL) and any(io.mouse_delta):
            right, down = _motion(size)
            editor.set_camera(orbit.dragged(context.session.viewport.camera, right, down), gesture="orbit")
            context.set_preference(newcomer=False)
        end_gesture(context)
        if imgui.is_item_hovered() and imgui.is_mouse_double_clicked(imgui.MouseButton_.left):
            context.session.viewport.reset_view()
        if imgui.is_window_hovered() and io.mouse_wheel:  # also over what is drawn over the view
            self._zoom(context, io.mouse_wheel)
        self._pan(context, size)
        if imgui.is_window_focused() or imgui.is_item_hovered():
            self._keys(context)

    def _pan(self, context: PanelContext, size: ImVec2) -> None:
        """Move the object while the middle or the right button is held, wherever in the view it was pressed."""
        buttons = (imgui.MouseButton_.middle, imgui.MouseButton_.right)
        if self._pans and any(imgui.get_io().mouse_delta):
            context.session.viewport.pan_by(*_motion(size))
        begins = imgui.is_window_hovered() and any(map(imgui.is_mouse_clicked, buttons))
        self._pans = any(map(imgui.is_mouse_down, buttons)) and (self._pans or begins)

    def _zoom(self, context: PanelContext, steps: float) -> None:
        """Zoom about the point under the mouse."""
        low, high = context.view
        viewport = context.session.viewport
        nearer = orbit.zoomed(viewport.camera, steps, context.session.editor.model)
        pointer = (imgui.get_mouse_pos() - (low + high) * 0.5) / min(high - low)
        away = pointer - ImVec2(*viewport.settings.offset)
        viewport.pan_by(*(away * (1 - viewport.camera.distance / nearer.distance)))
        self._nudge(context, nearer, "zoom")

    def _keys(self, context: PanelContext) -> None:
        camera = context.session.viewport.camera
        step = _KEY_TURN * (_FINE if imgui.get_io().key_shift else 1.0)
        if imgui.get_io().want_text_input or imgui.get_io().key_ctrl:
            return
        turns = {"left_arrow": (-step, 0), "right_arrow": (step, 0), "up_arrow": (0, step), "down_arrow": (0, -step)}
        for key, (azimuth, elevation) in turns.items():
            if imgui.is_key_pressed(getattr(imgui.Key, key)):
                self._nudge(context, orbit.turned(camera, azimuth, elevation), "keys")
        for sign, steps in (("+", 1), ("-", -1)):
            if any(map(is_pressed, chords(sign))) or is_typed(sign):
                self._nudge(context, orbit.zoomed(camera, steps, context.session.editor.model), "zoom")
        # In the view, the keyboard turns the object and moves no focus.
        if imgui.is_window_focused() and imgui.is_key_pressed(imgui.Key.tab):
            imgui.set_window_focus("Library")
            imgui.set_nav_cursor_visible(True)

    def _nudge(self, context: PanelContext, camera: orbit.Camera, gesture: str) -> None:
        context.set_preference(newcomer=False)
        context.session.editor.set_camera(camera, gesture)
        context.session.editor.end_gesture()


def _texture(context: PanelContext, pixels: tuple[int, int], ring: tuple[float, ...]) -> imgui.ImTextureRef:
    """Return the texture of the baked object if OpenGL draws it now, else of the newest frame."""
    viewport = context.session.viewport
    assert context.canvas and viewport.full_frame
    if viewport.baked_frame and viewport.baked:
        return context.canvas.draw_baked(viewport.baked, viewport.baked_frame, context.palette, ring)
    frame, crop = viewport.full_frame
    mode = viewport.settings.mode
    displayed = _in_mode(viewport.repainted or frame, crop, mode)
    return context.canvas.draw(displayed, crop, pixels, context.palette, mode == "colour", ring)


@lru_cache(1)
def _in_mode(frame: Frame, crop: orbit.PanelCrop, mode: str) -> Frame:
    """Return the shown part of a frame in a mode of the view."""
    return crop.cropped(in_mode(frame, crop.camera, mode))


def _motion(size: ImVec2) -> ImVec2:
    """Return the mouse's motion since the last frame, right and down, as fractions of the view's shorter side."""
    io = imgui.get_io()
    return io.mouse_delta * ((_FINE if io.key_shift else 1.0) / min(size.x, size.y))


def _draw_overlay(context: PanelContext, image: np.ndarray | None, corner: ImVec2, size: ImVec2) -> None:
    """Draw square pixels over the object."""
    if image is not None and context.session.viewport.source == "scene":
        side = min(size.x, size.y)
        pan = context.session.viewport.settings.offset
        low = corner + (size - ImVec2(side, side)) * 0.5 + ImVec2(*pan) * side
        draw = imgui.get_window_draw_list()
        draw.add_image(context.texture(image), low, low + ImVec2(side, side))


def _badge(context: PanelContext, frame: Frame) -> str:
    """Name the work after which the image will be final; empty if it is."""
    session = context.session
    viewport = session.viewport
    if viewport.source == "fit":
        return "Fitting …"
    if session.jobs.busy("paint"):
        return "Painting …"
    if viewport.baked_frame or viewport.frame_request is None:
        return ""
    if viewport.frame_request.instance != session.editor.scene.instance and not session.editor.history.gesture:
        return "Rendering …"
    return "Sharpening …" if min(frame.resolution) < _ENOUGH * min(viewport.settings.panel) else ""


def _draw_badge(context: PanelContext, frame: Frame, low: ImVec2) -> None:
    """Draw a badge above the corner ``low`` (lower left) while the image is not the final one."""
    width, height = frame.resolution
    words = _badge(context, frame)
    em = hello_imgui.em_size()
    if not words:
        return
    size = imgui.calc_text_size(words) + ImVec2(2.1, 0.5) * em
    low = low + ImVec2(0.7 * em, -size.y - 0.7 * em)
    draw = imgui.get_window_draw_list()
    draw.add_rect_filled(low, low + size, packed(PLATE, PLATE_OPACITY), 0.35 * em)
    draw.add_circle_filled(low + ImVec2(0.75 * em, size.y / 2), 0.24 * em, packed(WARM))
    draw.add_text(low + ImVec2(1.4, 0.25) * em, packed(ON_PLATE), words)
    imgui.set_cursor_screen_pos(low)
    imgui.invisible_button("badge", size)
    tooltip(f"{width} x {height} px, {frame.samples} samples; stage {frame.stage + 1} of {frame.stage_count}")


def _draw_buttons(context: PanelContext, corner: ImVec2, size: ImVec2) -> None:
    em = hello_imgui.em_size()
    imgui.set_cursor_screen_pos(corner + ImVec2(0.7 * em, 0.7 * em))
    for number, (action, icon) in enumerate(_BUTTONS.items()):
        if number:
            imgui.same_line(0, 0.3 * em)
        labelled = action == "share" and size.x > _NARROW * em
        action_button(context, action, f"{icon}  Share" if labelled else icon)
    left = imgui.get_item_rect_max().x
    right = corner.x + size.x
    if context.preferences.newcomer and right - left > imgui.calc_text_size(_HINT).x + 3 * em:
        _note(ImVec2((left + right) / 2, corner.y + 0.7 * em + imgui.get_frame_height() / 2), _HINT, 0.3)


def _note(centre: ImVec2, text: str, pad: float = 0.5) -> None:
    """Write a line on a plate, with ``pad`` em above and below."""
    paint_on_plate(centre - imgui.calc_text_size(text) * 0.5, text, ImVec2(1.0, pad) * hello_imgui.em_size())
