"""The help: a search for actions, panels, view modes and objects, and the table of keys and gestures."""

from collections.abc import Callable, Iterator
from functools import partial
from itertools import chain
from typing import NamedTuple

from imgui_bundle import hello_imgui, imgui

from viewer.actions import ACTIONS, TABLE, Action, Gesture
from viewer.context import PanelContext
from viewer.values.view_modes import MODES
from viewer.widgets.controls import begin_dialog
from viewer.widgets.text import heading

_WHAT, _DOES = 13, 32  # em: widths of the columns
_MOST = 12  # listed results
_IDLE = {"a", "an", "the", "it", "my", "i", "how", "to", "do", "make", "change"}  # words that need not be found
_SAME = {"color": "colour", "rotate": "turn", "delete": "remove", "export": "share", "resize": "size"}


class Entry(NamedTuple):
    """A result of the search."""

    words: str  # name
    description: str
    run: Callable[[], object]


class Help:
    """The help window."""

    def __init__(self) -> None:
        self._search = ""
        self._results: list[Entry] = []

    def draw(self, context: PanelContext) -> None:
        """Draw the search above its results or, by default, the table, while the help is open."""
        if not context.help_open:
            return
        is_drawn, context.help_open = begin_dialog("Help")
        if is_drawn:
            self._draw_search(context)
            room = imgui.get_main_viewport().work_size.x - hello_imgui.em_size(_WHAT + 3)
            if imgui.begin_table("help", 2):
                imgui.table_setup_column("what", imgui.TableColumnFlags_.width_fixed, hello_imgui.em_size(_WHAT))
                does = min(hello_imgui.em_size(_DOES), room)
                imgui.table_setup_column("does", imgui.TableColumnFlags_.width_fixed, does)
                self._draw_results(context) if self._search else _draw_table(context)
                imgui.end_table()
        imgui.end()

    def _draw_search(self, context: PanelContext) -> None:
        if imgui.is_window_appearing():
            self._search = ""
            self._results = []
            imgui.set_keyboard_focus_here()
        imgui.set_next_item_width(-1)
        if imgui.get_io().want_text_input and imgui.is_key_pressed(imgui.Key.f1, False):
            context.help_open = False
        hint = "Type what you look for; Enter does the first"
        previous = self._search
        enter = imgui.InputTextFlags_.enter_returns_true
        entered, self._search = imgui.input_text_with_hint("##search", hint, previous, enter)
        if self._search != previous:
            self._results = find(context, self._search)
        if entered and self._results:
            self._run(context, self._results[0])

    def _draw_results(self, context: PanelContext) -> None:
        if not self._results:
            imgui.table_next_column()
            imgui.table_next_column()
            imgui.text_wrapped("Nothing is called that. Try another word, such as paint, photo or undo")
        for number, entry in enumerate(self._results[:_MOST]):
            imgui.table_next_row()
            imgui.table_next_column()
            if imgui.selectable(f"{entry.words}###found {number}", number == 0)[0]:
                self._run(context, entry)
            imgui.table_next_column()
            imgui.text_wrapped(entry.description)

    @staticmethod
    def _run(context: PanelContext, entry: Entry) -> None:
        context.help_open = False
        entry.run()


def entries(context: PanelContext) -> Iterator[Entry]:
    """Yield the actions, gestures, panels, view modes and objects."""
    session = context.session
    for action in ACTIONS.values():
        run = partial(action.run, context) if action.enabled(context) else lambda: None
        yield Entry(action.words, action.hint(), run)
    for section, rows in TABLE.items():
        for row in rows:
            if isinstance(row, Gesture):
                panel = section if section in context.panels else ""
                yield Entry(row.words, f"{section}: {row.tooltip}", partial(setattr, context, "focus", panel))
    for title in context.panels:
        yield Entry(title, "panel", partial(setattr, context, "focus", title))
    for mode in MODES:
        yield Entry(mode.capitalize(), "view mode", partial(session.viewport.change, mode=mode))
    objects = session.editor.objects
    families = (objects.families[model.fingerprint] for model in session.models)
    added = (name for name in objects.own if not session.editor.objects.is_missing(name))
    listed = [*added, *chain.from_iterable(families)]
    names = {session.names.label(name): name for name in reversed(listed)}
    for words, name in names.items():
        yield Entry(words, "object", partial(session.editor.show_object, name))


def find(context: PanelContext, search: str) -> list[Entry]:
    """Return the entries that contain all words of a search, the likeliest first; none for no text."""
    text = search.strip().lower()
    sought = [_SAME.get(word, word) for word in text.split() if word not in _IDLE]
    ranked = list[tuple[int, Entry]]()
    for entry in entries(context) if text else ():
        words = entry.words.lower()
        searched = f"{words} {entry.description.lower()}"
        if text in searched or (sought and all(word in searched for word in sought)):
            ranks = words == text, words.startswith(text), text in words, text in searched, True
            ranked.append((ranks.index(True), entry))
    return [entry for _, entry in sorted(ranked, key=lambda result: result[0])]


def _draw_table(context: PanelContext) -> None:
    """Draw the actions by place."""
    for section, rows in TABLE.items():
        imgui.table_next_row()
        imgui.table_next_column()
        heading(context, section)
        for row in rows:
            imgui.table_next_row()
            imgui.table_next_column()
            imgui.text((row.keys or row.words) if isinstance(row, Action) else row.words)
            imgui.table_next_column()
            imgui.text_wrapped(row.tooltip)
