"""The undo history as thumbnails along the view's lower edge. Not a docked panel."""

from itertools import chain
from typing import NamedTuple

from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from core.detail.progressive import Frame
from viewer.activities.thumbnails import SIZE
from viewer.context import PanelContext
from viewer.values.history import Branch, Edit, History
from viewer.values.state import State
from viewer.widgets import missing_tiles, object_tiles
from viewer.widgets.controls import OVERLAY_FLAGS, tooltip
from viewer.widgets.text import push_small

_SIDE, _EDGE = 2.7, 0.5  # em: side of a thumbnail, and distance from the view's corner
_FOLDED = 0.8  # side of another branch's thumbnail, as a fraction of the others'
_FORK = icons_fontawesome_4.ICON_FA_CODE_BRANCH


class _Tile(NamedTuple):
    """A thumbnail: an edit of the current path, or the end of another branch."""

    name: str
    steps: tuple[int, ...]  # indices of the steps it stands for; the last one is shown
    words: str
    undone: bool = False
    branch: bool = False


class HistoryStrip:
    """A strip with a tile per object, the oldest first, and per edit of the object on screen.

    Undone edits are paler. The ends of other branches are smaller tiles, right of the edit at which they begin.
    """

    def __init__(self) -> None:
        self._scrolled_to = -1, 0.0  # step that was last scrolled to, and width of the strip then
        self._history: History | None = None  # history of the values below, kept while it is the same
        self._groups: tuple[tuple[Edit, ...], ...] = ()
        self._branches: tuple[Branch, ...] = ()

    def draw(self, context: PanelContext) -> None:
        """Draw the strip, scrolled to the current edit, once there are two edits."""
        history = context.session.editor.history
        label = context.session.names.label
        if history is not self._history:
            self._history = history
            self._groups = history.edits(label)
            self._branches = history.branches(label)
        em = hello_imgui.em_size()
        low, high = context.view
        context.covered = 0.0
        if sum(map(len, self._groups)) + len(self._branches) < 2:
            return
        tiles = self._tiles(history.current)
        side = _SIDE * em
        gap = 0.3 * em
        needed = sum(side * (_FOLDED if tile.branch else 1) + gap for tile in tiles) + 2 * gap
        width = min(high.x - low.x - 2 * _EDGE * em - context.card_width, needed)
        height = side + 3 * gap
        context.covered = height + _EDGE * em
        if context.share_open:  # a click beside the dialog would go back in time
            return
        imgui.set_next_window_pos(ImVec2(low.x + _EDGE * em, high.y - _EDGE * em - height))
        imgui.set_next_window_size((width, height))
        imgui.set_next_window_bg_alpha(0.85)
        imgui.push_style_var(imgui.StyleVar_.window_padding, (1.5 * gap, 1.5 * gap))
        imgui.push_style_var(imgui.StyleVar_.item_spacing, (gap, gap))
        hidden = imgui.WindowFlags_
        flags = OVERLAY_FLAGS & ~(hidden.always_auto_resize | hidden.no_nav) | hidden.horizontal_scrollbar
        if imgui.begin("History", None, flags)[0]:
            corner = imgui.get_cursor_screen_pos()
            for tile in tiles:
                corner = self._draw_tile(context, tile, corner, side) + ImVec2(gap, 0)
            if imgui.is_window_hovered() and (wheel := imgui.get_io().mouse_wheel):
                imgui.set_scroll_x(imgui.get_scroll_x() - wheel * side)
        imgui.end()
        imgui.pop_style_var(2)

    def _tiles(self, current: int) -> list[_Tile]:
        """Return the tiles of the current path, each followed by the branches that begin at its steps."""
        edits = list[Edit]()
        for group in self._groups:
            every = tuple(chain.from_iterable(edit.steps for edit in group))
            edits += group if current in every else (group[-1]._replace(steps=every),)
        tiles = list[_Tile]()
        undone = False
        for number, edit in enumerate(edits, 1):
            tiles.append(_Tile(f"state {number}", edit.steps, edit.words, undone))
            undone |= current in edit.steps
            for count, branch in enumerate(self._branches, 1):
                if branch.start in edit.steps:
                    tiles.append(_Tile(f"branch {count}", (branch.last,), branch.words, branch=True))
        return tiles

    def _draw_tile(self, context: PanelContext, tile: _Tile, corner: ImVec2, height: float) -> ImVec2:
        """Draw a tile, a click on which goes to the last of its steps; return the place right of it."""
        history = context.session.editor.history
        current = history.current
        side = height * (_FOLDED if tile.branch else 1)
        low = corner + ImVec2(0, height - side)
        is_current = current in tile.steps
        state = history.now if is_current else history.steps[tile.steps[-1]].state
        imgui.set_cursor_screen_pos(low)
        if not imgui.is_rect_visible((side, side)):  # hundreds of states cost nothing while scrolled away
            imgui.dummy((side, side))
        elif not context.session.editor.objects.can_show(state):
            missing_tiles.draw_state(context, state, tile.words, tile.name, side)
        else:
            if object_tiles.tile_button(tile.name, (side, side)) and not is_current:
                context.session.editor.go_to(tile.steps[-1])
            tooltip(_tooltip(tile, is_current))
            frame = _thumbnail(context, state, is_current and bool(history.gesture))
            object_tiles.paint_frame(context, frame, low, side)
        position = current, imgui.get_window_width()
        if is_current and self._scrolled_to != position:
            imgui.set_scroll_here_x()
            self._scrolled_to = position
        _draw_marks(context, tile, is_current, low, side)
        return corner + ImVec2(side, 0)


def _draw_marks(context: PanelContext, tile: _Tile, is_current: bool, low: ImVec2, side: float) -> None:
    """Draw the shade of an undone tile, the fork of a branch, and the border of the current one."""
    if tile.undone:
        object_tiles.shade(low, side, context.palette.panel, object_tiles.DIMMED)
    if tile.branch:
        push_small()
        object_tiles.mark(low, _FORK, context.palette.warm)
        imgui.pop_font()
    if is_current:
        object_tiles.outline(low, side, context.palette.accent)


def _tooltip(tile: _Tile, is_current: bool) -> str:
    """Return the tooltip of a tile."""
    if tile.branch:
        return f"Another branch\nClick to go to: {tile.words}"
    direction = "forward" if tile.undone else "back"
    return tile.words[:1].upper() + tile.words[1:] if is_current else f"Click to go {direction} to: {tile.words}"


def _thumbnail(context: PanelContext, state: State, moving: bool) -> Frame | None:
    """Return a state's thumbnail from its camera; None during a drag, which changes the state in every frame."""
    scene = state.scene
    is_current = state is context.session.editor.state
    camera = scene.camera.resized(SIZE, SIZE)
    return None if moving else context.session.thumbnails.get(scene.instance, camera, soon=is_current)
