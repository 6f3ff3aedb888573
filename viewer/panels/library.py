"""The library: a button for a photo, and thumbnails of added objects and of the models' objects."""

from collections.abc import Iterable, Sequence
from itertools import chain

from imgui_bundle import ImVec2, hello_imgui, icons_fontawesome_4, imgui

from core.models.codes import CODE_KINDS
from core.models.model import Model
from viewer.context import Panel, PanelContext
from viewer.screen.theme import WARM, Colour, mixed, packed
from viewer.values.encoding import Original
from viewer.values.fit_history import FitRequest
from viewer.values.variety import family, readable
from viewer.widgets import missing_tiles, object_tiles, user_objects, waiting_tiles
from viewer.widgets.controls import action_button, draw_choice, tooltip
from viewer.widgets.object_tiles import unmixable
from viewer.widgets.text import caption, heading, paint_caption, push_small, small_height
from viewer.widgets.welcome import Welcome

Tile = str | FitRequest | Original  # an object, by name; a waiting photo; a project file with unreadable parts

_INVITATION = "What you fit to photos comes here."
_STRIP = 9.0  # em: a lower panel is a strip
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
        names, least = _headings(context.session.listed_models), _STRIP * hello_imgui.em_size()
        if strip := imgui.get_content_region_avail().y < least:
            imgui.begin_child("filter", (least, 0), imgui.ChildFlags_.nav_flattened)
        if not Welcome.is_due(context):
            action_button(context, "fit_image", f"{_PHOTO}  Open photo", -1, context.palette.accent)
        choices = {_ALL: "All", **names, _MINE: "Mine"}
        self._filter = draw_choice(choices, self._filter if self._filter in choices else _ALL)
        if strip:
            imgui.end_child()
            imgui.same_line()
        scrolls = imgui.WindowFlags_.horizontal_scrollbar if strip else 0
        if imgui.begin_child("objects", (0, 0), imgui.ChildFlags_.nav_flattened, scrolls):
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
        listed = self._filter in (_ALL, _MINE)
        mine: list[Tile] = [*waiting, *session.editor.objects.own, *session.originals] if listed else [*waiting]
        families = session.editor.objects.families
        groups = {"Mine": mine} if mine or listed else dict[str, list[Tile]]()
        groups |= {
            name: [*self._listed(families[model])] for model, name in names.items() if self._filter in (_ALL, model)
        }
        if strip:
            self._draw_tiles(context, [*chain.from_iterable(groups.values())], True)
            return
        for title, tiles in groups.items():
            heading(context, title)
            if tiles:
                self._draw_tiles(context, tiles)
            else:
                caption(context, _INVITATION)
            imgui.spacing()

    def _listed(self, families: dict[str, tuple[str, ...]]) -> list[str]:
        """Return one object of each form, followed by its variants if it is unfolded."""
        names = list[str]()
        for head, variants in families.items():
            names += [head, *variants] if head in self._unfolded else [head]
        return names

    def _draw_tiles(self, context: PanelContext, tiles: Sequence[Tile], strip: bool = False) -> None:
        """Draw tiles in rows, or in one row."""
        em, room = hello_imgui.em_size(), imgui.get_content_region_avail()
        gap, least = 0.4 * em, object_tiles.THUMBNAIL * em
        columns = max(1, len(tiles)) if strip else max(2, int((room.x + gap) / (least + gap)))
        side = room.y - small_height() if strip else (room.x - gap * (columns - 1)) / columns
        size, start = ImVec2(side, side + small_height()), imgui.get_cursor_screen_pos()
        low, step, rows = imgui.get_window_pos() - start, size + ImVec2(gap, gap), -(-len(tiles) // columns)
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
        imgui.set_next_item_allow_overlap()
        below = corner + ImVec2(0, size.x)
        if isinstance(tile, FitRequest):
            waiting_tiles.draw(context, tile, corner, size)
            paint_caption(context, tile.history.name, below, size.x)
            return
        if isinstance(tile, Original):
            missing_tiles.draw_original(context, tile, corner, size)
            paint_caption(context, "damaged", below, size.x)
            return
        if context.session.editor.is_missing(tile):
            missing_tiles.draw_object(context, tile, corner, size)
            paint_caption(context, tile, below, size.x)
            return
        families = context.session.editor.objects.families_of(tile)
        _draw_object(context, tile, corner, size, self._user_menu)
        paint_caption(context, readable(family(tile) if tile in families else tile), below, size.x)
        if variants := families.get(tile, ()):
            self._draw_fold(context, tile, len(variants), corner, size.x)

    def _draw_fold(self, context: PanelContext, name: str, count: int, corner: ImVec2, side: float) -> None:
        """Draw the button that shows or folds an object's variants, in the corner of its thumbnail."""
        unfolded, em = name in self._unfolded, hello_imgui.em_size()
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


def _draw_object(
    context: PanelContext, name: str, corner: ImVec2, size: ImVec2, user_menu: user_objects.UserObjectMenu
) -> None:
    editor, side = context.session.editor, size.x
    if object_tiles.tile_button(f"show {name}", size):
        editor.show_object(name)
    hovered = imgui.is_item_hovered()
    about = f"{readable(name)}{user_objects.about(editor.objects[name])}"
    tooltip(f"{about}\nClick to show it, drag it onto B, right click for more")
    if imgui.begin_drag_drop_source():
        context.dragged = name
        imgui.set_drag_drop_payload_py_id(object_tiles.DRAGGED, 0)
        imgui.text(readable(name))
        imgui.end_drag_drop_source()
    if imgui.begin_popup_context_item():
        _draw_menu(context, name)
        if name in editor.objects.own:
            user_menu.draw(context, name)
        imgui.end_popup()
    object_tiles.paint(context, name, corner, side)
    for number, (label, colour) in enumerate(_marks(context, name)):
        object_tiles.outline(corner, side, colour, inset=2.0 * number)
        object_tiles.mark(corner + ImVec2(number * 1.3 * hello_imgui.em_size(), 0), label, colour)
    if hovered:
        object_tiles.shade(corner, side, (1, 1, 1), 0.12)
    user_objects.draw_dot(context, name, corner, side)


def _draw_menu(context: PanelContext, name: str) -> None:
    editor = context.session.editor
    mixable = editor.is_mixable(name)
    why = "" if mixable else unmixable(context, name)
    if imgui.menu_item_simple("Show it"):
        editor.show_object(name)
    for kind in CODE_KINDS:
        if imgui.menu_item_simple(f"Take only its {kind}", enabled=mixable and kind not in editor.locked):
            editor.take(kind, name)
        tooltip(why)
    if imgui.menu_item_simple("Make it B", enabled=mixable):
        editor.set_b(name)
    tooltip(why)


def _headings(models: Iterable[Model]) -> dict[str, str]:
    """Return the headings of models' objects by fingerprint; a second model of a category gets a number."""
    names = dict[str, str]()
    for model in models:
        name = model.category.capitalize() or "Objects"
        count = sum(known.split(" (")[0] == name for known in names.values())
        names[model.fingerprint] = f"{name} ({count + 1})" if count else name
    return names


def _marks(context: PanelContext, name: str) -> list[tuple[str, Colour]]:
    """Return letters or icons of an object's roles, with colours: A, source of A's shape or texture, B."""
    mix, accent = context.session.editor.state.mix, context.palette.accent
    if mix.a == (name, name):
        marks = [("A", accent)]
    else:
        marks = [(object_tiles.ICONS[kind], accent) for kind in CODE_KINDS if getattr(mix.a, kind) == name]
    return [*marks, ("B", WARM)] if mix.b == name else marks
