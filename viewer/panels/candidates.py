"""The candidates of a fit: hypotheses as tiles ranked by loss, and their cameras around the object."""

import math

import numpy as np
from imgui_bundle import ImVec2, hello_imgui, imgui

from viewer.activities.candidates import Tile
from viewer.context import Panel, PanelContext
from viewer.screen.theme import WARM, Colour, mixed, packed
from viewer.values.frusta import OverviewCamera, box, frustum, ring
from viewer.widgets import object_tiles
from viewer.widgets.controls import tooltip

_FADING = 2.0  # s of the fit that an eliminated one takes to fade
_FADED = 0.75
_PLAIN = (0.75, 0.77, 0.8)  # behind the ranks of all but the best
_DRAG = 0.01  # rad a px
_INSET = 0.45  # of the panel's width


class CandidatesPanel(Panel):
    """Live while a fit runs; a click prefers a hypothesis to all others."""

    title = "Candidates"
    dock = "Drawer"
    folded = True

    def __init__(self) -> None:
        self._overview = OverviewCamera()
        self._hovered: int | None = None

    def draw(self, context: PanelContext) -> None:
        """Tiles on the left, cameras on the right."""
        tiles = context.session.fitting.candidates.tiles
        if not tiles:
            imgui.text_wrapped(
                "While a photo is rebuilt, you see here which cameras and shapes are tried for it, the best first"
            )
            return
        room = imgui.get_content_region_avail()
        inset = min(room.y, _INSET * room.x)
        hovered, self._hovered = self._hovered, None
        if imgui.begin_child("tiles", (room.x - inset - imgui.get_style().item_spacing.x, 0)):
            self._draw_tiles(context, tiles)
        imgui.end_child()
        imgui.same_line()
        self._draw_cameras(context, tiles, hovered, inset)

    def _draw_tiles(self, context: PanelContext, tiles: tuple[Tile, ...]) -> None:
        em, room = hello_imgui.em_size(), imgui.get_content_region_avail()
        gap, least = 0.25 * em, 1.6 * em
        across = math.ceil(math.sqrt(len(tiles) * room.x / max(em, room.y)))
        across = max(1, min(across, int((room.x + gap) / (least + gap))))
        rows = math.ceil(len(tiles) / across)
        side = max(least, min(3.4 * em, room.x / across - gap, room.y / rows - gap))
        imgui.push_style_var(imgui.StyleVar_.item_spacing, (gap, gap))
        for number, tile in enumerate(tiles):
            if number % across:
                imgui.same_line()
            self._draw_tile(context, tile, number, side)
        imgui.pop_style_var()

    def _draw_tile(self, context: PanelContext, tile: Tile, rank: int, side: float) -> None:
        fitting, corner = context.session.fitting, imgui.get_cursor_screen_pos()
        preferable = fitting.can_resume(tile.hypothesis)
        if imgui.invisible_button(f"candidate {rank + 1}", (side, side)) and preferable:
            fitting.resume(tile.hypothesis)
        if imgui.is_item_hovered():
            self._hovered = tile.number
        tooltip(_label(tile, rank, preferable))
        object_tiles.paint_frame(context, tile.frame, corner, side)
        if faded := _fading(context, tile):
            veil = packed(context.palette.panel, _FADED * faded)
            imgui.get_window_draw_list().add_rect_filled(corner, corner + ImVec2(side, side), veil)
        else:
            object_tiles.mark(corner, str(rank + 1), context.palette.accent if rank == 0 else _PLAIN)
        if rank == 0:
            object_tiles.outline(corner, side, context.palette.accent)
        elif self._hovered == tile.number:
            object_tiles.outline(corner, side, WARM)

    def _draw_cameras(self, context: PanelContext, tiles: tuple[Tile, ...], hovered: int | None, side: float) -> None:
        model = context.session.models.of(tiles[0].hypothesis.codes)
        corner = imgui.get_cursor_screen_pos()
        imgui.invisible_button("cameras", (side, side))
        if imgui.is_item_active():
            moved = imgui.get_io().mouse_delta
            self._overview = self._overview.turned(_DRAG * moved.x, _DRAG * moved.y)
        tooltip("The candidate cameras around the object. Drag to see them from elsewhere")
        imgui.push_clip_rect(corner, corner + ImVec2(side, side), True)
        line = mixed(context.palette.panel, context.palette.text, 0.35)
        farthest = max(camera.distance for tile in tiles for camera in tile.hypothesis.cameras)
        middle, scale = corner + ImVec2(side / 2, side / 2), side / (2.3 * max(farthest, model.distance))

        def lines(segments: np.ndarray, colour: Colour, opacity: float = 1.0, width: float = 1.0) -> None:
            draw, packed_colour = imgui.get_window_draw_list(), packed(colour, opacity)
            for (x0, y0), (x1, y1) in self._overview.project(segments) * scale:
                draw.add_line(middle + ImVec2(x0, y0), middle + ImVec2(x1, y1), packed_colour, width)

        lines(ring(model.distance), line, 0.6)
        lines(box(model.extent), context.palette.text, 0.8)
        for rank, tile in reversed(list(enumerate(tiles))):
            if tile.number == hovered:
                colour, opacity, width = WARM, 1.0, 2.5
            else:
                colour = context.palette.accent if rank == 0 else context.palette.text
                opacity, width = 1.0 - 0.9 * _fading(context, tile), 2.0 if rank == 0 else 1.0
                opacity *= 1.0 if rank == 0 else 0.7
            for camera in tile.hypothesis.cameras:
                lines(frustum(camera), colour, opacity, width)
        imgui.pop_clip_rect()


def _fading(context: PanelContext, tile: Tile) -> float:
    """How far a tile has faded, 0..1."""
    last = context.session.fitting.history.last
    if tile.eliminated_at is None or last is None:
        return 0.0
    return min(1.0, 0.3 + (last.seconds - tile.eliminated_at) / _FADING)


def _label(tile: Tile, rank: int, preferable: bool) -> str:
    camera = tile.hypothesis.cameras[0]
    place = f"azimuth {math.degrees(camera.azimuth):.0f}, elevation {math.degrees(camera.elevation):.0f} degrees"
    place += f"\ndistance {camera.distance:.2f}, focal length {camera.focal / camera.height:.2f} of the image's height"
    state = f"Rank {rank + 1}" if tile.eliminated_at is None else f"Eliminated after {tile.eliminated_at:.1f} s"
    prefer = "\nClick to prefer it: the search continues from here alone" if preferable else ""
    return f"{state}, loss {tile.hypothesis.loss:.4f}\n{place}{prefer}"
