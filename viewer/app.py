"""The window of a session: its panels, dialogs and callbacks."""

import math
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import moderngl
from imgui_bundle import hello_imgui, imgui

from core.runtime.signals import TERMINATION, on_signals
from viewer.actions import run_keys
from viewer.context import Panel, PanelContext
from viewer.panels import all_panels, menu
from viewer.panels.help import Help
from viewer.panels.history import HistoryStrip
from viewer.panels.messages import MessageLine
from viewer.panels.segmenting import SegmentingDialog
from viewer.panels.share import ShareDialog
from viewer.screen import fonts, theme, window
from viewer.screen.canvas import Canvas, Images
from viewer.screen.file_dialog import FileDialog
from viewer.screen.opengl_speed import is_fast
from viewer.services.clipboard import Clipboard
from viewer.services.messages import error_text
from viewer.services.single_instance import SingleInstance, Start
from viewer.session import Session
from viewer.values.preferences import Preferences

_RATE, _RATE_BESIDE_WORKER, _RATE_OF_PROGRESS, _RATE_OF_FILMS = 60.0, 30.0, 8.0, 20.0
"""Limits of frames per second: usually; if OpenGL and a busy worker share the processor; then without input; and while
previews of films move."""
_ANSWERS = imgui.Key.enter, imgui.Key.keypad_enter, imgui.Key.escape, imgui.Key.f1  # keys that close fields or dialogs
_TOUCHED = 0.7  # s after an input during which the window counts as touched
_INSPECTOR = 300.0, 0.185  # least width, px at 96 ppi; fraction of the window's width
_LIBRARY = 140.0, 0.09  # as of the inspector
_NARROW = 1100.0  # px at 96 ppi: in a narrower window the library is a strip below the view
_OTHER_WIDTH = 0.25  # natural logarithm of a change of width after which panels are placed again
_STRIP = 105.0  # px at 96 ppi, height of the strip


class App:
    """The window: panels docked around the view, dialogs, menus and messages."""

    _gl: moderngl.Context | None = None  # None until the window is open
    _surface: moderngl.Framebuffer | None = None  # drawn to by an invisible window
    _software = False  # OpenGL shares the processor with the worker
    _touched = 0.0  # s on the monotonic clock, time of the last input
    _themed: bool | None = None  # the dark theme is applied
    _popup_open = False  # a popup was open before this frame; imgui closes some on Esc

    def __init__(
        self,
        session: Session,
        size: tuple[int, int] | None = (1280, 800),
        folder: Path | None = None,
        headless: bool = False,
        native_dialogs: bool | None = None,
        instance: SingleInstance | None = None,
    ) -> None:
        """Prepare the window; :meth:`run` opens it.

        Args:
            size: width and height, px at 96 ppi; None takes most of the screen.
            folder: folder of layout, preferences and kept work; None keeps nothing.
            headless: draw an invisible window.
            native_dialogs: use the system's file dialogs; None: if it has them.
            instance: source of the files of later starts.
        """
        window.prepare(headless)
        self.session = session
        self._folder = folder
        self._headless = headless
        self._instance = instance
        self._size = size or window.usual_size(headless)
        self.params = window.parameters(self._size, folder)
        self.panels: list[Panel] = all_panels()
        self.context = self._new_context(native_dialogs)
        self._saved_preferences = self.context.preferences
        self._segmenting = SegmentingDialog()
        self._share = ShareDialog()
        self._overlays = {"history": HistoryStrip().draw, "help": Help().draw}
        self._message = MessageLine()
        self._folded: list[Panel] = []  # panels that were shown before the view was shown alone
        self._reported: dict[str, str] = {}  # errors of callbacks that failed in the last frame
        self.each_frame: Callable[[], None] = lambda: None
        self._dock()
        self._connect()
        session.start()

    def _new_context(self, native_dialogs: bool | None) -> PanelContext:
        """Return the context of the panels, with the preferences and the work in the folder."""
        context = PanelContext(
            self.session,
            FileDialog(native_dialogs),
            quit=self._quit,
            reset_layout=self._reset_layout,
            fold_panels=self._fold_panels,
            panels=tuple(panel.title for panel in self.panels),
        )
        if self._folder:
            context.preferences = Preferences.load(self._folder)
            context.files.save_in(context.preferences.folder)
            context.clipboard = Clipboard(self._folder / "pasted")
            self.session.resume()
        return context

    def run(self) -> None:
        """Open the window; return when it is closed, by a person or a signal."""
        on_signals(lambda _: self._quit(), (*TERMINATION, "SIGINT"))
        window.run(self.params)

    def _finish_frame(self) -> None:
        assert self._gl is not None, "no window yet"
        self._gl.finish()

    def _quit(self) -> None:
        self.params.app_shall_exit = True

    def _reset_layout(self) -> None:
        """Reset every panel to its initial place and visibility."""
        for panel in self.panels:
            self._dockable_of(panel).is_visible = not panel.folded
        self._place_panels()
        self.context.focus = "Mix"

    def _place_panels(self) -> None:
        """Dock the panels at their initial places for the window's size."""
        docking = self.params.docking_params
        size = imgui.get_main_viewport().size / hello_imgui.dpi_window_size_factor()
        docking.docking_splits = self._splits(*size)
        self._width = size.x
        docking.layout_reset = True
        self.context.focus = self.context.focus or self._front_panel()

    def _front_panel(self) -> str:
        """Return the title of the inspector's panel in front; empty if all are hidden."""
        titles = (panel.title for panel in self.panels if panel.dock == "Right")
        windows = {title: imgui.internal.find_window_by_name(title) for title in titles}
        return next((title for title, docked in windows.items() if docked and docked.active and not docked.hidden), "")

    def _follow_width(self) -> None:
        """Place the panels again after a large change of width, and where the library becomes a strip."""
        width = imgui.get_main_viewport().size.x / hello_imgui.dpi_window_size_factor()
        if not width:  # there is no window yet
            return
        if (width < _NARROW) != (self._width < _NARROW) or abs(math.log(width / self._width)) > _OTHER_WIDTH:
            self._place_panels()

    def _follow_text(self) -> None:
        """Widen the docked panels with the text."""
        ratio = self.context.preferences.text / self._text
        self._text *= ratio
        half = imgui.get_main_viewport().size.x / 2
        for side in ("Left", "Right") if ratio != 1 else ():
            number = self.params.docking_params.dock_space_id_from_name(side) or 0
            if node := imgui.internal.dock_builder_get_node(number):
                size = imgui.ImVec2(min(half, node.size.x * ratio), node.size.y * ratio)
                imgui.internal.dock_builder_set_node_size(number, size)

    def _fold_panels(self) -> None:
        """Hide all panels but the view; if they are hidden, show those from before or the initial ones."""
        docked = [panel for panel in self.panels if panel.dock != "View"]
        if visible := [panel for panel in docked if self._dockable_of(panel).is_visible]:
            self._folded = visible
        for panel in docked:
            reappears = panel in self._folded if self._folded else not panel.folded
            self._dockable_of(panel).is_visible = reappears and not visible

    def _dockable_of(self, panel: Panel) -> hello_imgui.DockableWindow:
        return self.params.docking_params.dockable_window_of_name(panel.title)

    def _connect(self) -> None:
        calls = self.params.callbacks
        calls.load_additional_fonts = self._load_fonts
        calls.setup_imgui_style = theme.set_spacing
        calls.post_init = self._opened
        calls.before_exit = self._closing
        calls.pre_new_frame = self._before_frame
        calls.show_gui = self._draw
        calls.show_menus = self._draw_menus
        if self._headless:
            window.make_headless(self.params, self._finish_frame)
        self.session.jobs.worker.wake = hello_imgui.request_refresh

    def _dock(self) -> None:
        window_params = self.params.imgui_window_params
        window_params.show_menu_bar = True
        window_params.show_menu_app = window_params.show_menu_view = False
        window_params.show_menu_view_themes = False
        docking = self.params.docking_params
        self._text = self.context.preferences.text  # size by which the panels are as wide as they are
        self._width = float(self._size[0])
        docking.docking_splits = self._splits(*self._size)
        docking.dockable_windows = [self._dockable(panel) for panel in self.panels]

    def _splits(self, width: float, height: float) -> list[hello_imgui.DockingSplit]:
        """Return the layout at a size in px at 96 ppi: the library left or, if narrow, below; the inspector right."""
        dirs = imgui.Dir
        right, left = (max(self._text * min_width, fraction * width) for min_width, fraction in (_INSPECTOR, _LIBRARY))
        library = (dirs.down, self._text * _STRIP / height) if width < _NARROW else (dirs.left, left / (width - right))
        return [
            hello_imgui.DockingSplit("MainDockSpace", "Right", dirs.right, min(right / width, 0.5)),  # half at most
            hello_imgui.DockingSplit("MainDockSpace", "Left", *library),
        ]

    def _dockable(self, panel: Panel) -> hello_imgui.DockableWindow:
        view = panel.dock == "View"
        dock = "MainDockSpace" if view else panel.dock
        window = hello_imgui.DockableWindow(panel.title, dock, lambda: self._draw_panel(panel))
        window.can_be_closed = panel.folded
        window.is_visible = not panel.folded
        if panel.bare:
            window.call_begin_end = False
            window.gui_function = lambda: self._draw_bare(panel)
        return window

    def _draw_bare(self, panel: Panel) -> None:
        """Draw a panel without a tab; the view without a scroll bar too: overlays must not change its size."""
        bare = imgui.WindowClass()
        docked = imgui.internal.find_window_by_name(panel.title)
        is_shared = docked and docked.dock_node and len(docked.dock_node.windows) > 1
        hidden = imgui.internal.DockNodeFlagsPrivate_.no_tab_bar  # and no triangle in the corner that shows it
        bare.dock_node_flags_override_set = imgui.DockNodeFlags_.auto_hide_tab_bar if is_shared else hidden
        imgui.set_next_window_class(bare)
        fixed = (
            imgui.WindowFlags_.no_scrollbar | imgui.WindowFlags_.no_scroll_with_mouse | imgui.WindowFlags_.no_nav_inputs
        )
        view = panel.dock == "View"
        imgui.push_style_var(imgui.StyleVar_.window_padding, (0, 0) if view else imgui.get_style().window_padding)
        visible = imgui.begin(panel.title, None, fixed if view else 0)[0]
        imgui.pop_style_var()
        if visible:
            self._draw_panel(panel)
        imgui.end()

    def _draw_panel(self, panel: Panel) -> None:
        """Draw a panel, and its error if it fails; other panels go on."""
        if error := self._guard(f"The panel {panel.title} failed", lambda: panel.draw(self.context)):
            imgui.text_wrapped(f"This panel failed: {error_text(error)}")

    def _guard(self, what: str, draw: Callable[[], None]) -> Exception | None:
        """Call ``draw`` and return its error, if any; an error that recurs in every frame is reported once."""
        state = imgui.internal.ErrorRecoveryState()
        imgui.internal.error_recovery_store_state(state)
        try:
            draw()
        except Exception as error:
            imgui.internal.error_recovery_try_to_recover_state(state)
            if self._reported.get(what) != str(error):
                self._reported[what] = str(error)
                self.session.messages.report(what, error)
            return error
        self._reported.pop(what, None)
        return None

    def _load_fonts(self) -> None:
        self.context.bold = fonts.load_fonts()

    def _opened(self) -> None:
        self._gl = moderngl.get_context()
        self._software = window.in_software(self._gl)
        self.context.canvas = Canvas(self._gl)
        self.context.images = Images(self._gl)
        # OpenGL in software shares the processor with the network, and takes seconds to say how slow it is.
        self.context.fast_opengl = not self._software and is_fast(self._gl)
        # imgui logs errors in a panel instead of ending the program.
        io = imgui.get_io()
        io.config_error_recovery_enable_assert = io.config_error_recovery_enable_tooltip = False
        io.config_drag_click_to_input_text = True  # a click on a number is for typing
        io.config_flags |= imgui.ConfigFlags_.nav_enable_keyboard.value
        if self._folder and (width := hello_imgui.load_user_pref("width").strip()).isdigit():
            self._width = float(width)  # the layout is the last launch's
        self.context.focus = self.context.focus or self.context.preferences.front
        self.session.messages.restart()
        window.on_drop(self._dropped)
        window.limit_size()
        if self._headless:
            window.resize(*self._size)
            self._surface = window.draw_into(self._gl, self._size)

    def _dropped(self, paths: list[str]) -> None:
        try:
            self.context.drop(paths)
        except Exception as error:  # glfw would raise it in a later call
            self.session.messages.report("Cannot take this file", error)

    def _take(self, start: Start) -> None:
        """Open the files of a second start."""
        window.bring_to_front()
        if start.model:
            self.session.open_model(start.model)
        if start.image:
            self.context.fit(Path(start.image))

    def _closing(self) -> None:
        window.set_title(f"{window.NAME}: saving …")
        if self._instance:
            self._instance.end()
        self.context.files.close()
        self.session.jobs.worker.stop()  # its current step goes on while the session is saved
        self.session.recording.close()
        self._save_preferences()
        if self._folder:
            hello_imgui.save_user_pref("width", f"{self._width:.0f}")
        window.hide()  # all is saved; nobody has to look at the window until the worker's step ends
        self.session.jobs.worker.close()
        assert self.context.canvas and self.context.images
        self.context.canvas.release()
        self.context.images.release()

    def _before_frame(self) -> None:
        self._popup_open = imgui.is_popup_open("", imgui.PopupFlags_.any_popup)
        try:
            self.session.tick()
            for start in self._instance.starts() if self._instance else ():
                self._take(start)
        except Exception as error:  # in one callback; the others run in the next frame
            self.session.messages.report("Something went wrong", error)
        preferences = self.context.preferences
        if preferences.dark != self._themed:
            self._themed = preferences.dark
            theme.apply(self.context.palette)
            self.params.imgui_window_params.background_color = imgui.ImVec4(*self.context.palette.back, 1.0)
        imgui.get_style().font_scale_main = preferences.text
        self._follow_width()
        self._follow_text()
        front = self._front_panel()
        if front or not any(self._dockable_of(panel).is_visible for panel in self.panels if panel.dock == "Right"):
            self.context.set_preference(front=front)
        if not self._headless:
            self.params.fps_idling.fps_max = self.rate()
        self.each_frame()

    def rate(self) -> float:
        """Return the limit of frames per second now: low if OpenGL shares the processor with a busy worker."""
        io = imgui.get_io()
        if any(io.mouse_delta) or any(io.mouse_down) or io.mouse_wheel or imgui.is_any_item_active():
            self._touched = time.monotonic()
        if self.session.exporting.films.moving:
            return _RATE_OF_FILMS
        if not (self._software and self.session.jobs.busy()):
            return _RATE
        return _RATE_BESIDE_WORKER if time.monotonic() - self._touched < _TOUCHED else _RATE_OF_PROGRESS

    def _draw_menus(self) -> None:
        self._guard("The menu failed", lambda: menu.draw(self.context, self._message.draw))

    def _draw(self) -> None:
        """Run pressed keys, and draw everything that is not docked."""
        context = self.context
        if imgui.get_io().input_queue_characters or any(map(imgui.is_key_pressed, _ANSWERS)):
            imgui.get_current_context().nav_highlight_item_under_nav = False  # no tooltip of what has the focus next
        self._guard("This key failed", lambda: run_keys(context))
        self._guard("This key failed", lambda: self._close_top(context))
        for name, draw in self._overlays.items():
            self._guard(f"The {name} failed", partial(draw, context))
        if self._guard("The Share dialog failed", lambda: self._share.draw(context)):
            context.share_open = False
        self._guard("Cannot take this file", context.files.draw)
        if self._guard("The photo cannot be segmented", lambda: self._segmenting.draw(context)):
            context.session.segmenting.close()
        if context.focus:
            docking = self.params.docking_params
            docking.dockable_window_of_name(context.focus).is_visible = True
            docking.focus_dockable_window(context.focus)
            self._folded = []
            context.focus = ""
        assert context.images is not None
        context.images.sweep()
        if not imgui.is_any_mouse_down():
            self._save_preferences()

    def _close_top(self, context: PanelContext) -> None:
        """On Esc undo a drag, else close open menus and lists, the help or Share; modal dialogs close themselves."""
        if not imgui.is_key_pressed(imgui.Key.escape):
            return
        if self.session.painting.dragged:
            self.session.painting.cancel()
        elif self.session.editor.history.gesture:
            self.session.editor.cancel_gesture()
        elif self._popup_open:
            imgui.internal.close_popups_except_modals()
        elif context.help_open:
            context.help_open = False
        elif not imgui.is_any_item_active():  # Esc ends typing into a field first
            context.share_open = False

    def _save_preferences(self) -> None:
        """Save changed preferences at once, so that a crash does not lose them."""
        self.context.set_preference(folder=str(self.context.files.saves))
        if self._folder and self.context.preferences != self._saved_preferences:
            self._saved_preferences = self.context.preferences
            try:
                self._saved_preferences.save(self._folder)
            except (ValueError, OSError) as error:
                self.session.messages.report("Cannot save the preferences", error)
