"""What mouse and keys do. It must tell the truth: a change of either is a change here."""

from imgui_bundle import hello_imgui, imgui

from viewer.context import Desk

LINES = (
    ("In the view", ""),
    ("Drag, or arrow keys", "turn the object"),
    ("Wheel, or + and -", "zoom"),
    ("Shift", "with drag or arrows: finer"),
    ("1, 2, 3, 4", "front, side, top, the photo's camera"),
    ("Middle or right drag", "push the object aside in the view"),
    ("Double click, or Home", "back to the first view, the object in the middle"),
    ("V", "colour, depth, normals, opacity, samples of each ray"),
    ("The badge", "amber: a preview, being refined; green: the finished picture"),
    ("Objects", ""),
    ("Click", "show the object; it is A"),
    ("Right click", "take only a part, make it B, add it to the sheet"),
    ("Drag", "onto a slot (shape, texture, B) or the sheet"),
    ("Mix", ""),
    ("Lock", "keeps shape or texture from being changed"),
    ("Drag in the pad", "across: shape from A to B; upwards: texture"),
    ("Sheet", ""),
    ("Click", "make a pair current; at the border: take the object off"),
    ("Codes", ""),
    ("R", "a random shape and texture; what is locked stays"),
    ("Click a picture", "under a slider: go to -2, 0 or +2"),
    ("Hover over a slider", "which pixels it changes, and whether the silhouette moves"),
    ("Ctrl+click", "type a value"),
    ("Right click", "set the direction to 0"),
    ("Timeline", ""),
    ("K", "what is shown becomes a key, or replaces the one at this time"),
    ("Space", "play, pause"),
    ("Click or drag a key", "show it, move it in time; right click to replace or remove it"),
    ("Visited", ""),
    ("Click a picture", "go back, or forward, to that state"),
    ("Fit", ""),
    ("Drag in wipe, onion skin", "more of the photo, or of the render"),
    ("Hold F", "the photo in place of the render"),
    ("Drag along the curves", "see any step of the fit, here and in the view"),
    ("Click in the race", "prefer a candidate: the fit goes on from there alone"),
    ("Fit again", "from the step shown, from the camera in the view, or from the beginning"),
    ("Cut out", ""),
    ("Drag", "a box around the object, or strokes that add or remove"),
    ("Ctrl+Z", "take the last box or stroke back"),
    ("Files", ""),
    ("Drop an image", "fit it (Ctrl+I to choose one, Ctrl+V to paste one)"),
    ("Drop several", "of one object: fit them together; poses (.txt) go with images of their names"),
    ("Drop a scene (.json)", "open it (Ctrl+O to choose, Ctrl+S to save)"),
    ("Drop a picture saved here", "a png brings its codes and camera back"),
    ("Everywhere", ""),
    ("Ctrl+Z", "undo; a drag is one step"),
    ("Ctrl+Y, Ctrl+Shift+Z", "redo"),
    ("F1, ?", "this help"),
    ("Ctrl++, Ctrl+-", "larger text, smaller text"),
    ("Ctrl+Q", "quit"),
)


def draw(desk: Desk) -> None:
    """A window, while it is wanted."""
    if not desk.help_open:
        return
    viewport = imgui.get_main_viewport()
    imgui.set_next_window_pos(viewport.get_center(), imgui.Cond_.appearing, (0.5, 0.5))
    imgui.set_next_window_size_constraints((0, 0), viewport.work_size)  # a low window scrolls
    flags = imgui.WindowFlags_
    unmoved = flags.no_saved_settings | flags.no_docking | flags.no_collapse | flags.always_auto_resize
    shown, stays = imgui.begin("Help", True, unmoved)
    desk.help_open = bool(stays)
    if shown and imgui.begin_table("help", 2):
        imgui.table_setup_column("what", imgui.TableColumnFlags_.width_fixed, hello_imgui.em_size(12))
        imgui.table_setup_column("does", imgui.TableColumnFlags_.width_fixed, hello_imgui.em_size(26))
        for what, does in LINES:
            imgui.table_next_row()
            imgui.table_next_column()
            imgui.text_disabled(what) if not does else imgui.text(what)
            imgui.table_next_column()
            imgui.text(does)
        imgui.end_table()
    imgui.end()
