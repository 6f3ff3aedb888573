"""The panel of the timeline: keyframes along a ruler, played in the view and written to a file."""

from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from core.export.keyframes import Keyframe
from viewer.activities.player import Player
from viewer.activities.thumbnails import SIZE
from viewer.context import Panel, PanelContext
from viewer.screen.theme import mixed, packed
from viewer.widgets import missing_tiles, object_tiles
from viewer.widgets.controls import action_button, button, end_gesture, flow, tooltip

_PLAY = icons_fontawesome_4.ICON_FA_PLAY
_PAUSE = icons_fontawesome_4.ICON_FA_PAUSE
_ADD = icons_fontawesome_4.ICON_FA_PLUS
_VIDEO = icons_fontawesome_4.ICON_FA_FILM
_LENGTH = 4.5  # em, width of the field for the timeline's length
_INVITATION = "Show something, add a keyframe (K); move on in time, show something else, add another. Space plays."


class TimelinePanel(Panel):
    """Buttons above a ruler of time with the keyframes."""

    title = "Timeline"
    dock = "Drawer"
    folded = True

    def draw(self, context: PanelContext) -> None:
        """Draw the buttons, the ruler and the keyframes."""
        player = context.session.player
        action_button(context, "play", _PAUSE if player.playing else _PLAY)
        imgui.same_line(0, hello_imgui.em_size(0.3))
        action_button(context, "add_key", _ADD)
        flow("length", _LENGTH)
        _draw_length(context, player)
        flow("Loop" + 6 * " ")
        changed, on = imgui.checkbox("Loop", player.timeline.loop)
        if changed:
            player.loop(on)
        tooltip("After the last keyframe comes the first again, so that it can be shown over and over")
        flow(f"{_VIDEO}  Share…")
        has_keys = bool(player.timeline.keys)
        if button(f"{_VIDEO}  Share…###share video", "Save the timeline as a video", enabled=has_keys):
            context.share("video")
        _draw_line(context, player)


def _draw_length(context: PanelContext, player: Player) -> None:
    imgui.set_next_item_width(hello_imgui.em_size(_LENGTH))
    changed, length = imgui.drag_float("##length", player.timeline.length, 0.05, 0.2, 600.0, "%.1f s")
    if changed:
        player.stretch(length)
    end_gesture(context)
    tooltip("How long the timeline is. Drag, or click to type")


def _draw_line(context: PanelContext, player: Player) -> None:
    timeline = player.timeline
    em = hello_imgui.em_size()
    corner = imgui.get_cursor_screen_pos()
    room = imgui.get_content_region_avail()
    ruler = 1.4 * em
    side = max(2 * em, min(4 * em, room.y - 1.8 * em))
    left = corner.x + side / 2
    width = max(1.0, room.x - side)
    imgui.invisible_button("time", (room.x, ruler))
    if imgui.is_item_active():
        player.seek((imgui.get_mouse_pos().x - left) / width * timeline.length)
    end_gesture(context)
    tooltip("Click or drag to move the playhead")
    _paint_ruler(context, player, ImVec2(left, corner.y), width, ruler, side)
    for index, key in enumerate(timeline.keys):
        x = left + width * key.seconds / timeline.length - side / 2
        _draw_key(context, player, index, key, ImVec2(x, corner.y + ruler), side, width)
    if not timeline.keys:
        imgui.set_cursor_screen_pos(corner + ImVec2(0, ruler + 0.3 * em))
        imgui.text_wrapped(_INVITATION)
        return
    x = left + width * player.seconds / timeline.length
    line = packed(context.palette.accent)
    imgui.get_window_draw_list().add_line((x, corner.y), (x, corner.y + ruler + side), line, 2.0)


def _draw_key(
    context: PanelContext, player: Player, index: int, key: Keyframe, corner: ImVec2, side: float, width: float
) -> None:
    imgui.set_cursor_screen_pos(corner)
    imgui.set_next_item_allow_overlap()
    moved = imgui.get_mouse_drag_delta(imgui.MouseButton_.left)  # until the release, that frame included
    if object_tiles.tile_button(f"key {index + 1}", (side, side)) and not any(moved):
        player.go_to_key(index)
    across = imgui.get_io().mouse_delta.x
    if imgui.is_item_active() and across and imgui.is_mouse_dragging(imgui.MouseButton_.left):
        player.move_key(index, player.timeline.keys[index].seconds + across / width * player.timeline.length)
    end_gesture(context)
    if key.view.instance.is_missing:
        tooltip(
            f"Key {index + 1} needs {context.session.model_name(key.view.instance.fingerprint)}, which is not there"
        )
        missing_tiles.paint(context, "", corner, side)
        return
    tooltip(f"Key {index + 1} at {key.seconds:.2f} s\nClick to show it, drag it in time; Delete removes the shown one")
    thumbnail = context.session.thumbnails.get(key.view.instance, key.view.camera.resized(SIZE, SIZE), soon=True)
    object_tiles.paint_frame(context, thumbnail, corner, side)
    quiet = mixed(context.palette.panel, context.palette.text, 0.4)
    object_tiles.outline(corner, side, context.palette.accent if player.key == index else quiet)


def _paint_ruler(
    context: PanelContext, player: Player, corner: ImVec2, width: float, height: float, side: float
) -> None:
    draw = imgui.get_window_draw_list()
    palette = context.palette
    length = player.timeline.length
    opposite = corner + ImVec2(width, height)
    draw.add_rect_filled(corner, opposite, packed(palette.raised), object_tiles.rounding())
    line = packed(mixed(palette.raised, palette.text, 0.35))
    text = packed(mixed(palette.raised, palette.text, 0.6))
    least = length * 4 * hello_imgui.em_size() / width
    step = next((step for step in (0.1, 0.2, 0.5, 1, 2, 5, 10, 30, 60) if step >= least), 120)
    for number in range(int(length / step) + 1):
        x = corner.x + width * number * step / length
        draw.add_line((x, opposite.y - 0.4 * height), (x, opposite.y), line)
        if x < opposite.x - side:
            draw.add_text(ImVec2(x + 3, corner.y), text, f"{number * step:g}")
    label = f"{player.seconds:.2f} s"
    draw.add_text(ImVec2(opposite.x - imgui.calc_text_size(label).x - 4, corner.y), packed(palette.text), label)
