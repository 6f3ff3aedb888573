"""The menu bar, and the keys that work everywhere."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from imgui_bundle import hello_imgui, imgui

from core.models.library import samples, shipped_models
from viewer.context import Desk, chord, tip
from viewer.values.preferences import LARGEST, SMALLEST

_Chord = tuple[int, Callable[[], None]]


def draw(desk: Desk) -> None:
    """Menus, and at their right what is going on."""
    session, ready = desk.session, desk.session.ready
    if imgui.begin_menu("File"):
        idle = ready and not session.fitting.running
        _item("Fit image…###fit image", "Ctrl+I", desk.fit_image, idle)
        _item("Paste image###paste", "Ctrl+V", desk.paste, idle)
        _draw_samples(desk, idle)
        imgui.separator()
        _item("Open scene…###open scene", "Ctrl+O", desk.open_scene, ready)
        _item("Save scene…###save scene", "Ctrl+S", desk.save_scene, ready)
        _draw_recent(desk, ready)
        imgui.separator()
        _item("Quit", "Ctrl+Q", desk.quit)
        imgui.end_menu()
    _draw_models(desk)
    if imgui.begin_menu("Edit"):
        history = session.history
        _item("Undo", "Ctrl+Z", session.undo, bool(history and history.past))
        _item("Redo", "Ctrl+Y", session.redo, bool(history and history.future))
        imgui.separator()
        _item("Reset view", "Home", session.reset_view, ready)
        imgui.end_menu()
    hello_imgui.show_view_menu(hello_imgui.get_runner_params())  # panels, and the layout's reset
    if imgui.begin_menu("Look"):
        likes = desk.likes
        desk.chose(dark=imgui.menu_item("Dark", "", likes.dark)[1])
        desk.chose(smooth=imgui.menu_item("Smooth the finished picture###smooth", "", likes.smooth)[1])
        imgui.separator()
        _item("Larger text", "Ctrl++", partial(desk.size_text, 1), likes.text < LARGEST)
        _item("Smaller text", "Ctrl+-", partial(desk.size_text, -1), likes.text > SMALLEST)
        imgui.separator()
        _item("Reset layout", "", desk.reset_layout)
        imgui.end_menu()
    if imgui.begin_menu("Help"):
        _, desk.help_open = imgui.menu_item("Keys and mouse", "F1", desk.help_open)
        imgui.end_menu()
    _draw_status(desk)


def keys(desk: Desk) -> None:
    """Shortcuts; to be called once a frame, outside of any window."""
    key, typing = imgui.Key, imgui.get_io().want_text_input
    chords = [(chord(key.mod_ctrl, key.q), desk.quit), *_text_keys(desk)]
    if not desk.session.cutting.active:  # which has keys of its own, and would hide the help
        chords += _edit_keys(desk)
        asked = imgui.is_key_chord_pressed(chord(key.mod_shift, key.slash)) and not typing
        if asked or imgui.is_key_pressed(key.f1, repeat=False):
            desk.help_open = not desk.help_open
    for pressed, act in chords:
        if not typing and imgui.is_key_chord_pressed(pressed):
            act()


def _text_keys(desk: Desk) -> list[_Chord]:
    key, chords = imgui.Key, list[_Chord]()
    for plus, minus in ((key.equal, key.minus), (key.keypad_add, key.keypad_subtract)):
        chords.append((chord(key.mod_ctrl, plus), partial(desk.size_text, 1)))
        chords.append((chord(key.mod_ctrl, minus), partial(desk.size_text, -1)))
    return chords


def _edit_keys(desk: Desk) -> list[_Chord]:
    session, key = desk.session, imgui.Key
    chords: list[_Chord] = [
        (chord(key.mod_ctrl, key.z), session.undo),
        (chord(key.mod_ctrl, key.mod_shift, key.z), session.redo),
        (chord(key.mod_ctrl, key.y), session.redo),
    ]
    if not session.ready:
        return chords
    for digit, view in enumerate(("front", "side", "top", "photo"), 1):
        see = partial(session.see_from, view)
        chords += [(getattr(key, f"_{digit}"), see), (getattr(key, f"keypad{digit}"), see)]
    chords += [(chord(key.mod_ctrl, key.s), desk.save_scene), (chord(key.mod_ctrl, key.o), desk.open_scene)]
    chords += [(key.space, session.film.toggle), (key.k, session.film.add_key), (key.r, session.randomise_all)]
    if not session.fitting.running:
        chords += [(chord(key.mod_ctrl, key.i), desk.fit_image), (chord(key.mod_ctrl, key.v), desk.paste)]
    return chords


def _item(label: str, keys: str, act: Callable[[], None], enabled: bool = True) -> None:
    if imgui.menu_item(label, keys, False, enabled)[0]:
        act()


def _draw_models(desk: Desk) -> None:
    session = desk.session
    if imgui.begin_menu("Model"):
        for name in shipped_models():
            here = session.opened == name
            if imgui.menu_item(name, "", here, not (session.loading or session.fitting.running))[0] and not here:
                session.open_model(name)
            tip("What you have made stays with its model, and comes back with it; undo begins anew")
        imgui.end_menu()


def _draw_samples(desk: Desk, enabled: bool) -> None:
    model = desk.session.model
    if imgui.begin_menu("Fit a sample", enabled):
        for path in samples(model.category) if model else ():
            _item(path.stem, "", partial(desk.fit, path))
        imgui.end_menu()


def _draw_recent(desk: Desk, enabled: bool) -> None:
    if imgui.begin_menu("Open recent", enabled and bool(desk.likes.recent)):
        for number, name in enumerate(desk.likes.recent):
            _item(f"{Path(name).name}###recent {number + 1}", "", partial(desk.drop, [name]))
            tip(name)
        imgui.end_menu()


def _draw_status(desk: Desk) -> None:
    session = desk.session
    model = session.model
    told = [f"Loading {session.loading} …"] if session.loading else []
    if session.fitting.running:
        told.append(f"Fitting {session.fitting.course.progress:.0%}")
    if session.exporting.running:
        told.append(f"Exporting {session.exporting.progress:.0%}")
    if model:
        told.append(f"{model.category}: {len(session.gallery.names)} objects")
    text = "      ".join(told)
    width = imgui.calc_text_size(text).x + 2 * hello_imgui.em_size()
    imgui.same_line(imgui.get_window_width() - width)
    imgui.text_disabled(text)
