"""The film: keyframes along a line of time, played in the view and written to a file."""

from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from core.export.keyframes import Key
from viewer.activities.player import Film
from viewer.context import VIDEOS, Desk, button, draw_progress, flow, tip
from viewer.screen.file_dialog import Wish
from viewer.screen.theme import mixed, packed
from viewer.widgets import object_tiles as faces
from viewer.widgets.video_form import VideoForm

_PLAY, _PAUSE = icons_fontawesome_4.ICON_FA_PLAY, icons_fontawesome_4.ICON_FA_PAUSE
_ADD, _REMOVE = icons_fontawesome_4.ICON_FA_PLUS, icons_fontawesome_4.ICON_FA_TRASH
_FILM = icons_fontawesome_4.ICON_FA_FILM
_STILL = 64
"""px"""
_LOOPS = 1.5
"""The step over the seam, in the longest of the others, that still looks like one of them."""
_INVITATION = "Show something, add a key (K); go on in time, show something else, add another. Space plays."


class TimelinePanel:
    """Buttons above a line of time with the keys on it."""

    title = "Timeline"
    dock = "Strip"

    def __init__(self) -> None:
        self._form = VideoForm()
        self._seam: tuple[object, float] = None, 0.0
        """of which timeline, and how large its jump is"""

    def draw(self, desk: Desk) -> None:
        """The buttons, the line, the keys."""
        if not desk.session.ready:
            imgui.text_disabled("The timeline comes with the model")
            return
        film = desk.session.film
        if not draw_progress(desk, "film"):
            self._draw_buttons(desk, film)
        _draw_line(desk, film)

    def _draw_buttons(self, desk: Desk, film: Film) -> None:
        timeline, here, gap = film.timeline, film.key, hello_imgui.em_size(0.3)
        label, told = (_PAUSE, "Pause (Space)") if film.playing else (_PLAY, "Play in the view (Space)")
        if button(f"{label}###play", told, width=2.4, enabled=bool(timeline.keys)):
            film.toggle()
        imgui.same_line(0, gap)
        told = "What is shown becomes a key at this time (K)"
        if here is not None:
            told = "What is shown takes the place of the key at this time (K)"
        if button(f"{_ADD}  {'Key' if here is None else 'Replace'}###add key", told, width=6):
            film.add_key()
        imgui.same_line(0, gap)
        if button(f"{_REMOVE}###remove key", "Take the key at this time out", enabled=here is not None):
            film.remove_key(here if here is not None else 0)
        imgui.same_line()
        self._draw_numbers(desk, film)
        imgui.same_line()
        self._draw_export(desk)
        self._draw_check(desk, film)

    def _draw_numbers(self, desk: Desk, film: Film) -> None:
        timeline = film.timeline
        imgui.set_next_item_width(hello_imgui.em_size(4.5))
        changed, length = imgui.drag_float("##length", timeline.length, 0.05, 0.2, 600.0, "%.1f s")
        if changed:
            film.stretch(length)
        if imgui.is_item_deactivated():
            desk.session.settle()
        tip("How long the film is. Drag, or Ctrl+click to type")
        imgui.same_line()
        imgui.set_next_item_width(hello_imgui.em_size(5))
        changed, turns = imgui.slider_int("##turns", timeline.turns, -3, 3, "%d turns")
        if changed and turns != timeline.turns:
            film.set_turns(turns)
        tip("Full turns of the camera around the object in the whole film, besides what the keys do")
        imgui.same_line()
        changed, smooth = imgui.checkbox("Smooth", timeline.smooth)
        if changed:
            film.set_smooth(smooth)
        tip("Through the keys without corners (Catmull-Rom), or straight from one to the next")
        imgui.same_line()
        changed, loop = imgui.checkbox("Loop", timeline.loop)
        if changed:
            film.set_loop(loop)
        tip("After the last key it goes on to the first, so that it can be shown over and over")

    def _draw_export(self, desk: Desk) -> None:
        exporting, keys = desk.session.exporting, desk.session.state.timeline.keys
        enabled = bool(keys) and not exporting.running
        if button(f"{_FILM}  Export…###film form", "Write the film to a file", enabled=enabled):
            imgui.open_popup("film form")
        if imgui.begin_popup("film form"):
            self._form.draw()
            suffix, choice = self._form.suffix, self._form.choice
            if button("Export film…###export film", "Choose where to, and write it"):
                imgui.close_current_popup()
                wish = Wish(
                    "Export the film as", lambda path: exporting.film(path, choice), VIDEOS, True, f"film{suffix}"
                )
                desk.files.ask(wish)
            imgui.end_popup()

    def _draw_check(self, desk: Desk, film: Film) -> None:
        timeline = film.timeline
        if not timeline.keys:
            return
        if self._seam[0] is not timeline and not imgui.is_mouse_down(imgui.MouseButton_.left):
            self._seam = timeline, timeline.seam()
        seam = self._seam[1]
        told = "Loops without a jump" if seam < _LOOPS else f"Jumps at the end ({seam:.0f} steps)"
        flow(told)
        imgui.text_disabled(told)
        tip("The step from the last picture back to the first, against the longest step between any others")


def _draw_line(desk: Desk, film: Film) -> None:
    timeline, em = film.timeline, hello_imgui.em_size()
    corner, room = imgui.get_cursor_screen_pos(), imgui.get_content_region_avail()
    ruler, side = 1.4 * em, max(1.5 * em, min(4 * em, room.y - 1.7 * em))
    left, width = corner.x + side / 2, max(1.0, room.x - side)
    imgui.invisible_button("time", (room.x, ruler))
    if imgui.is_item_active():
        film.seek((imgui.get_mouse_pos().x - left) / width * timeline.length)
    if imgui.is_item_deactivated():
        desk.session.settle()
    tip("Click or drag to stand at another time")
    _paint_ruler(desk, film, ImVec2(left, corner.y), width, ruler, side)
    for index, key in enumerate(timeline.keys):
        x = left + width * key.seconds / timeline.length - side / 2
        _draw_key(desk, film, index, key, ImVec2(x, corner.y + ruler), side, width)
    if not timeline.keys:
        imgui.set_cursor_screen_pos(corner + ImVec2(0, ruler + 0.3 * em))
        imgui.text_wrapped(_INVITATION)
        return
    x = left + width * film.seconds / timeline.length
    line = packed(desk.palette.accent)
    imgui.get_window_draw_list().add_line((x, corner.y), (x, corner.y + ruler + side), line, 2.0)


def _draw_key(desk: Desk, film: Film, index: int, key: Key, corner: ImVec2, side: float, width: float) -> None:
    imgui.set_cursor_screen_pos(corner)
    imgui.set_next_item_allow_overlap()
    moved = imgui.get_mouse_drag_delta(imgui.MouseButton_.left)  # until it is let go, and in that frame still
    if imgui.invisible_button(f"key {index + 1}", (side, side)) and not any(moved):
        film.go_to_key(index)
    across = imgui.get_io().mouse_delta.x
    if imgui.is_item_active() and across and imgui.is_mouse_dragging(imgui.MouseButton_.left):
        film.move_key(index, film.timeline.keys[index].seconds + across / width * film.timeline.length)
    if imgui.is_item_deactivated():
        desk.session.settle()
    tip(f"Key {index + 1} at {key.seconds:.2f} s\nClick to show it, drag it in time, right click to choose")
    if imgui.begin_popup_context_item():
        if imgui.menu_item_simple("Replace with what is shown"):
            film.replace_key(index)
        if imgui.menu_item_simple("Remove"):
            film.remove_key(index)
        imgui.end_popup()
    picture = desk.session.stills.picture(key.shot.codes, key.shot.camera.resized(_STILL, _STILL), soon=True)
    faces.paint_frame(desk, picture, corner, side)
    chosen = film.key == index
    faces.frame(corner, side, desk.palette.accent if chosen else mixed(desk.palette.panel, desk.palette.text, 0.4))


def _paint_ruler(desk: Desk, film: Film, corner: ImVec2, width: float, height: float, side: float) -> None:
    draw, palette, length = imgui.get_window_draw_list(), desk.palette, film.timeline.length
    opposite = corner + ImVec2(width, height)
    draw.add_rect_filled(corner, opposite, packed(palette.raised), faces.rounding())
    line, text = packed(mixed(palette.raised, palette.text, 0.35)), packed(mixed(palette.raised, palette.text, 0.6))
    least = length * 4 * hello_imgui.em_size() / width
    step = next((step for step in (0.1, 0.2, 0.5, 1, 2, 5, 10, 30, 60) if step >= least), 120)
    for number in range(int(length / step) + 1):
        x = corner.x + width * number * step / length
        draw.add_line((x, opposite.y - 0.4 * height), (x, opposite.y), line)
        if x < opposite.x - side:
            draw.add_text(ImVec2(x + 3, corner.y), text, f"{number * step:g}")
    told = f"{film.seconds:.2f} s"
    draw.add_text(ImVec2(opposite.x - imgui.calc_text_size(told).x - 4, corner.y), packed(palette.text), told)
