"""The library: a button for a photo, and thumbnails of added objects and of the models' objects."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from typing import NamedTuple

from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from core.models.model import Instance, Model
from viewer.context import Panel, PanelContext
from viewer.screen.theme import WARM, Colour, mixed, packed
from viewer.values.fit_history import FitRequest
from viewer.widgets import missing_tiles, object_tiles, user_objects, waiting_tiles
from viewer.widgets.controls import action_button, draw_choice, tooltip
from viewer.widgets.object_tiles import unmixable
from viewer.widgets.text import caption, heading, paint_caption, push_small, small_height
from viewer.widgets.welcome import Welcome


class Version(NamedTuple):
    """One of the versions of an added object."""

    root: str  # name of the object
    instance: Instance  # the version as left; the first one as fitted or opened
    number: int  # place among the versions, from 0


Tile = str | Version | FitRequest  # an object, by name; a version of one; a waiting photo

_INVITATION = "What you fit to photos comes here."
_STRIP = 9.0  # em: a lower panel is a strip
_LINE = 1.9  # em, side of a version's tile, with its name beside it
_ALL, _MINE = "all", "mine"
_PHOTO = icons_fontawesome_4.ICON_FA_IMAGE
_OPEN = icons_fontawesome_4.ICON_FA_CARET_DOWN


class LibraryPanel(Panel):
    """Tiles of objects: a click shows one as A, a drag makes it B, a right click opens its menu."""

    title = "Library"
    dock = "Left"
    bare = True

    def __init__(self) -> None:
        self._user_menu = user_objects.UserObjectMenu()
        self._unfolded = set[str]()  # names of objects whose variants are shown
        self._waiting = 0  # photos that waited in the last frame; new ones are scrolled into sight
        self._filter = _ALL  # listed objects: all, added ones ("mine"), or a model's, by its fingerprint

    def draw(self, context: PanelContext) -> None:
        """Draw the button, the filter and the tiles; thumbnails out of sight are not rendered."""
        names = _headings(context.session.models)
        min_size = _STRIP * hello_imgui.em_size()
        if strip := imgui.get_content_region_avail().y < min_size:
            imgui.begin_child("filter", (min_size, 0), imgui.ChildFlags_.nav_flattened)
        if not Welcome.is_due(context):
            action_button(context, "fit_image", f"{_PHOTO}  Open photo", -1, context.palette.accent)
        choices = {_ALL: "All", **names, _MINE: "Mine"}
        self._filter = draw_choice(choices, self._filter if self._filter in choices else _ALL)
        if strip:
            imgui.end_child()
            imgui.same_line()
        scrolls = imgui.WindowFlags_.horizontal_scrollbar if strip else 0
        if imgui.begin_child("objects", (0, 0), imgui.ChildFlags_.nav_flattened, scrolls):
            if strip and imgui.is_window_hovered() and (wheel := imgui.get_io().mouse_wheel):
                imgui.set_scroll_x(imgui.get_scroll_x() - wheel * min_size)
            self._draw_objects(context, names, strip)
        imgui.end_child()
        self._user_menu.apply(context)

    def _draw_objects(self, context: PanelContext, names: dict[str, str], strip: bool) -> None:
        """Draw waiting photos and added objects, then those of each model, under headings or in one row."""
        session = context.session
        waiting = session.fitting.pending
        if len(waiting) > self._waiting:
            imgui.set_scroll_x(0.0)
            imgui.set_scroll_y(0.0)
        self._waiting = len(waiting)
        objects = session.editor.objects
        families = objects.families
        listed_own = [name for name in objects.own if self._filter in (_ALL, _MINE, objects[name].instance.fingerprint)]
        mine: list[Tile] = [*waiting, *listed_own]
        groups = {"Mine": mine} if mine or self._filter in (_ALL, _MINE) else dict[str, list[Tile]]()
        groups |= {
            name: [*self._listed(families[model])] for model, name in names.items() if self._filter in (_ALL, model)
        }
        if strip:
            listed = chain.from_iterable(groups.values())
            tiles = [*chain.from_iterable((tile, *_versions(context, tile)) for tile in listed)]
            self._draw_tiles(context, tiles, True)
            return
        for title, group in groups.items():
            heading(context, title)
            for tiles, versions in _rows(context, group):
                self._draw_tiles(context, tiles)
                for version in versions:
                    self._draw_version(context, version)
            if not group:
                caption(context, _INVITATION)
            imgui.spacing()

    def _draw_version(self, context: PanelContext, version: Version) -> None:
        """Draw a version's small tile, and its name beside it."""
        em = hello_imgui.em_size()
        corner = imgui.get_cursor_screen_pos()
        size = ImVec2(imgui.get_content_region_avail().x, _LINE * em)
        if imgui.is_rect_visible(size):
            _draw_button(context, version, corner, size, self._user_menu)
            position = corner + ImVec2(size.y + 0.4 * em, (size.y - small_height()) / 2)
            words = context.session.names.version(version.root, version.instance)
            paint_caption(context, words, position, size.x - size.y - 0.4 * em, across=0.0, quiet=False)
        else:
            imgui.dummy(size)

    def _listed(self, families: dict[str, tuple[str, ...]]) -> list[str]:
        """Return one object of each form, followed by its variants if it is unfolded."""
        names = list[str]()
        for head, variants in families.items():
            names += [head, *variants] if head in self._unfolded else [head]
        return names

    def _draw_tiles(self, context: PanelContext, tiles: Sequence[Tile], strip: bool = False) -> None:
        """Draw tiles in rows, or in one row."""
        em = hello_imgui.em_size()
        room = imgui.get_content_region_avail()
        gap = 0.4 * em
        min_size = object_tiles.THUMBNAIL * em
        columns = max(1, len(tiles)) if strip else max(2, int((room.x + gap) / (min_size + gap)))
        side = room.y - small_height() if strip else (room.x - gap * (columns - 1)) / columns
        size = ImVec2(side, side + small_height())
        start = imgui.get_cursor_screen_pos()
        low = imgui.get_window_pos() - start
        step = size + ImVec2(gap, gap)
        rows = -(-len(tiles) // columns)
        high = low + imgui.get_window_size()
        for row in _range(low.y, high.y, step.y, rows):
            for column in _range(low.x, high.x, step.x, columns):
                if (number := row * columns + column) < len(tiles):
                    corner = start + ImVec2(column * step.x, row * step.y)
                    imgui.set_cursor_screen_pos(corner)
                    self._draw_tile(context, tiles[number], corner, size)
        imgui.set_cursor_screen_pos(start)
        imgui.dummy((columns * step.x - gap, max(0.0, rows * step.y - gap)))

    def _draw_tile(self, context: PanelContext, tile: Tile, corner: ImVec2, size: ImVec2) -> None:
        below = corner + ImVec2(0, size.x)
        if isinstance(tile, FitRequest):
            waiting_tiles.draw(context, tile, corner, size)
            paint_caption(context, tile.history.name, below, size.x)
            return
        if isinstance(tile, str) and context.session.editor.objects.is_missing(tile):
            missing_tiles.draw_object(context, tile, corner, size)
            paint_caption(context, tile, below, size.x)
            return
        names = context.session.names
        objects = context.session.editor.objects
        words = names.version(tile.root, tile.instance) if isinstance(tile, Version) else names.caption(tile)
        paint_caption(context, words, below, size.x)
        draw = imgui.get_window_draw_list()
        draw.channels_split(2)  # the button in the tile's corner gets the mouse before the tile, and is drawn on it
        if isinstance(tile, str) and (variants := objects.families_of(tile).get(tile, ())):
            draw.channels_set_current(1)
            self._draw_fold(context, tile, len(variants), corner, size.x)
        draw.channels_set_current(0)
        imgui.set_cursor_screen_pos(corner)
        _draw_button(context, tile, corner, size, self._user_menu)
        draw.channels_merge()

    def _draw_fold(self, context: PanelContext, name: str, count: int, corner: ImVec2, side: float) -> None:
        """Draw the button that shows or folds an object's variants, in the corner of its thumbnail."""
        unfolded = name in self._unfolded
        em = hello_imgui.em_size()
        label = _OPEN if unfolded else str(count)
        push_small()
        size = imgui.calc_text_size(label) + ImVec2(0.6 * em, 0)
        low = corner + ImVec2(side, side) - size
        imgui.set_cursor_screen_pos(low)
        if object_tiles.tile_button(f"variants of {name}", size):
            self._unfolded ^= {name}
        colour = mixed(context.palette.panel, context.palette.accent, 0.5 if imgui.is_item_hovered() else 0.0)
        tooltip(
            "Fold its variants away" if unfolded else f"Show {count} variant{'s' if count > 1 else ''} of this form"
        )
        draw = imgui.get_window_draw_list()
        draw.add_rect_filled(low, low + size, packed(colour, 0.85), object_tiles.rounding())
        draw.add_text(low + ImVec2(0.3 * em, 0), packed(context.palette.text), label)
        imgui.pop_font()


def _range(low: float, high: float, step: float, count: int) -> range:
    """Return the numbers of tiles in sight, and of one more at each end, where the arrow keys go.

    Tiles out of sight cost nothing, even hundreds.
    """
    return range(max(0, int(low / step) - 1), min(count, int(high / step) + 2))


def _versions(context: PanelContext, tile: Tile) -> list[Version]:
    """Return the versions of an object that was edited; none for any other tile."""
    editor = context.session.editor
    if not isinstance(tile, str) or not editor.objects.is_added(tile) or editor.objects.is_missing(tile):
        return []
    states = [state for state in editor.objects.states(tile) if not state.is_missing]
    return [Version(tile, state, number) for number, state in enumerate(states)] if len(states) > 1 else []


def _rows(context: PanelContext, tiles: Iterable[Tile]) -> Iterator[tuple[list[Tile], list[Version]]]:
    """Yield consecutive tiles with the versions that follow them: an object with versions is by itself."""
    row = list[Tile]()
    for tile in tiles:
        if versions := _versions(context, tile):
            yield row, []
            yield [tile], versions
            row = []
        else:
            row.append(tile)
    yield row, []


class _Face(NamedTuple):
    """Contents of a tile: an object's or a version's."""

    button: str  # id
    instance: Instance
    names: Sequence[str]  # names of the objects that it shows
    words: str  # for the tooltip


def _face(context: PanelContext, tile: str | Version) -> _Face:
    session = context.session
    objects = session.editor.objects
    if isinstance(tile, Version):
        words = session.names.version(tile.root, tile.instance)
        button = f"version {tile.number} of {tile.root}"
        return _Face(button, tile.instance, objects.named(tile.root, tile.instance), words)
    name = session.editor.last_version(tile)
    words = f"{session.names.label(tile)}{user_objects.about(objects[tile])}"
    return _Face(f"show {tile}", objects[name].instance, [name], words)


def _draw_button(
    context: PanelContext, tile: str | Version, corner: ImVec2, size: ImVec2, menu: user_objects.UserObjectMenu
) -> None:
    """Draw an object or a version with its reactions: click, drag onto B, and menu."""
    side = min(size.x, size.y)
    face = _face(context, tile)
    if object_tiles.tile_button(face.button, size):
        context.session.editor.show_object(_name(context, tile))
    hovered = imgui.is_item_hovered()
    tooltip(f"{face.words}\nClick to show it, drag it onto B, right click for more")
    if imgui.begin_drag_drop_source():
        context.dragged = _name(context, tile)
        imgui.set_drag_drop_payload_py_id(object_tiles.DRAGGED, 0)
        imgui.text(face.words)
        imgui.end_drag_drop_source()
    if imgui.begin_popup_context_item():
        _draw_menu(context, tile, menu)
        imgui.end_popup()
    object_tiles.paint(context, face.instance, corner, side)
    for number, (label, colour) in enumerate(_marks(context, face.names)):
        object_tiles.outline(corner, side, colour, inset=2.0 * number)
        if isinstance(tile, str):
            object_tiles.mark(corner + ImVec2(number * 1.3 * hello_imgui.em_size(), 0), label, colour)
    if hovered:
        object_tiles.shade(corner, side, (1, 1, 1), 0.12)
    if isinstance(tile, str):
        user_objects.draw_dot(context, tile, corner, side)


def _name(context: PanelContext, tile: str | Version) -> str:
    """Return the name of a tile's object: the version shown last, or the tile's."""
    editor = context.session.editor
    return editor.objects.version(tile.root, tile.instance) if isinstance(tile, Version) else editor.last_version(tile)


def _draw_menu(context: PanelContext, tile: str | Version, menu: user_objects.UserObjectMenu) -> None:
    """Draw the menu of an object or a version; added objects and versions have further entries."""
    editor = context.session.editor
    objects = editor.objects
    root = tile.root if isinstance(tile, Version) else tile
    mixable = editor.is_mixable(root)
    if imgui.menu_item_simple("Make it B", enabled=mixable):
        editor.set_b(_name(context, tile))
        context.focus = "Mix"
    tooltip("" if mixable else unmixable(context, root))
    if isinstance(tile, Version):
        versions = objects.named(tile.root, tile.instance)
        name = versions[0] if versions else tile.root
        renamed = "" if tile.number == 0 or name == tile.root else name
        menu.draw(context, name, tile.instance, renamed, versions if tile.number else ())
    elif objects.is_added(tile):
        name = _name(context, tile)
        menu.draw(context, name, objects[name].instance, tile, objects.versions(tile))


def _headings(models: Iterable[Model]) -> dict[str, str]:
    """Return the headings of models' objects by fingerprint; a second model of a category gets a number."""
    names = dict[str, str]()
    for model in models:
        name = model.category.capitalize() or "Objects"
        count = sum(title.split(" (")[0] == name for title in names.values())
        names[model.fingerprint] = f"{name} ({count + 1})" if count else name
    return names


def _marks(context: PanelContext, names: Sequence[str]) -> list[tuple[str, Colour]]:
    """Return letters of the roles of a tile's objects, with colours."""
    mix = context.session.editor.state.mix
    marks = [("A", context.palette.accent)] if mix.a.shape in names else []
    return [*marks, ("B", WARM)] if mix.b in names else marks
