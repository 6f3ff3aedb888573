"""The operating system's window: its preparation, parameters and run."""

import sys
import warnings
from collections.abc import Callable
from pathlib import Path

from imgui_bundle import glfw_utils, hello_imgui, immapp  # before glfw, so that both use the same library

import glfw  # isort: skip
import moderngl

NAME = "CodeNeRF Viewer"
SMALLEST = 900, 600  # least width and height, px of a 96 ppi screen
ADD_ONS = immapp.AddOnsParams(with_implot=True)  # panels draw plots
_SHARE = 0.85  # fraction of the screen's width and height that a new window takes


class NoDisplayError(RuntimeError):
    """The machine has no display for a window, or no OpenGL."""


def prepare(headless: bool) -> None:
    """Initialise glfw and OpenGL before every run, for an invisible window if ``headless``.

    Raises :class:`NoDisplayError` with one line of advice.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", glfw.GLFWError)
        if headless:
            glfw.init_hint(glfw.PLATFORM, glfw.PLATFORM_NULL)
        if not glfw.init():
            raise NoDisplayError(
                "no display for a window: run on a desktop (or with ssh -X), or save an image of the "
                "window with --screenshot out.png"
            )
        if headless:
            glfw.window_hint(glfw.CONTEXT_CREATION_API, glfw.EGL_CONTEXT_API)
        _try_opengl()


def _try_opengl() -> None:
    hints = {
        glfw.VISIBLE: glfw.FALSE,
        glfw.CONTEXT_VERSION_MAJOR: 3,
        glfw.CONTEXT_VERSION_MINOR: 3,
        glfw.OPENGL_PROFILE: glfw.OPENGL_CORE_PROFILE,
        glfw.OPENGL_FORWARD_COMPAT: glfw.TRUE,
    }
    for hint, value in hints.items():
        glfw.window_hint(hint, value)
    probe = glfw.create_window(64, 64, NAME, None, None)
    glfw.window_hint(glfw.VISIBLE, glfw.TRUE)
    if not probe:
        raise NoDisplayError("OpenGL 3.3 is missing: install a graphics driver (Debian, Ubuntu: libegl1 libgl1)")
    glfw.destroy_window(probe)


def parameters(size: tuple[int, int], folder: Path | None) -> hello_imgui.RunnerParams:
    """Return the parameters of the window's runner.

    Args:
        size: (width, height) in px of a 96 ppi screen.
        folder: folder of the layout between launches; None stores nothing.
    """
    params = hello_imgui.RunnerParams()
    params.app_window_params.window_title = NAME
    params.app_window_params.window_geometry.size = size
    params.app_window_params.window_geometry.position_mode = hello_imgui.WindowPositionMode.monitor_center
    params.app_window_params.restore_previous_geometry = folder is not None
    params.ini_disable = folder is None
    if folder:
        folder.mkdir(parents=True, exist_ok=True)
        params.ini_folder_type = hello_imgui.IniFolderType.absolute_path
        params.ini_filename = str(folder / "window.ini")
    # The default, 8 samples, costs more than half the frame rate with software OpenGL.
    params.renderer_backend_options.open_gl_options = hello_imgui.OpenGlOptions(anti_aliasing_samples=0)
    params.fps_idling.fps_idle = 1.0
    params.fps_idling.time_active_after_last_event = 0.5
    params.fps_idling.fps_max = 60.0
    params.imgui_window_params.default_imgui_window_type = (
        hello_imgui.DefaultImGuiWindowType.provide_full_screen_dock_space
    )
    return params


def usual_size(headless: bool) -> tuple[int, int]:
    """Return the size of a new window in px of a 96 ppi screen; call after :func:`prepare`."""
    monitor = None if headless else glfw.get_primary_monitor()
    if monitor is None:
        return 1280, 800
    width, height = glfw.get_monitor_workarea(monitor)[2:]
    scale = 1.0 if sys.platform == "darwin" else glfw.get_monitor_content_scale(monitor)[0]  # there px are points
    return max(SMALLEST[0], round(_SHARE * width / scale)), max(SMALLEST[1], round(_SHARE * height / scale))


def make_headless(params: hello_imgui.RunnerParams, finish: Callable[[], None]) -> None:
    """Draw without pause, and call ``finish`` after every frame, as no display limits OpenGL's queue."""
    params.fps_idling.enable_idling = False
    params.fps_idling.fps_max = 0.0
    params.callbacks.after_swap = finish


def run(params: hello_imgui.RunnerParams) -> None:
    """Open the window and return when it is closed."""
    immapp.run(params, ADD_ONS)


def on_drop(dropped: Callable[[list[str]], None]) -> None:
    """Call ``dropped`` with the paths of files dropped on the window."""
    window = glfw_utils.glfw_window_hello_imgui()
    glfw.set_drop_callback(window, lambda _, paths: dropped(list(paths)))  # type: ignore[arg-type, misc]


def limit_size() -> None:
    """Keep the window so large that its controls are reachable, and shrink it if it is larger than its monitor.

    It is larger if it was last used at another scale of the screen, for example.
    """
    window = glfw_utils.glfw_window_hello_imgui()
    glfw.set_window_size_limits(window, *SMALLEST, glfw.DONT_CARE, glfw.DONT_CARE)
    (x, y) = glfw.get_window_pos(window)
    (width, height) = glfw.get_window_size(window)

    def overlap(area: tuple[int, int, int, int]) -> int:
        left, top, area_width, area_height = area
        wide = min(x + width, left + area_width) - max(x, left)
        high = min(y + height, top + area_height) - max(y, top)
        return max(0, wide) * max(0, high)

    areas = map(glfw.get_monitor_workarea, glfw.get_monitors())
    left, top, area_width, area_height = max(areas, key=overlap, default=(x, y, width, height))
    if width > area_width or height > area_height:
        left_frame, above, right_frame, below = glfw.get_window_frame_size(window)
        glfw.set_window_pos(window, left + left_frame, top + above)
        glfw.set_window_size(
            window, min(width, area_width - left_frame - right_frame), min(height, area_height - above - below)
        )


def draw_into(context: moderngl.Context, size: tuple[int, int]) -> moderngl.Framebuffer:
    """Redirect the window's drawing to a framebuffer of ``size`` px, and return it.

    An invisible window has no surface larger than the screen.
    """
    surface = context.framebuffer([context.renderbuffer(size)], context.depth_renderbuffer(size))
    surface.use()
    return surface


def bring_to_front() -> None:
    """Bring the window to the front, or request attention on systems that forbid that."""
    window = glfw_utils.glfw_window_hello_imgui()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", glfw.GLFWError)
        if glfw.get_window_attrib(window, glfw.ICONIFIED):
            glfw.restore_window(window)
        glfw.focus_window(window)
        if not glfw.get_window_attrib(window, glfw.FOCUSED):
            glfw.request_window_attention(window)


def set_title(title: str) -> None:
    """Change the title, which the system shows even while no frame is drawn."""
    glfw.set_window_title(glfw_utils.glfw_window_hello_imgui(), title)


def hide() -> None:
    """Take the window off the screen."""
    glfw.hide_window(glfw_utils.glfw_window_hello_imgui())


def resize(width: int, height: int) -> None:
    """Resize the window to these px, even beyond the screen."""
    glfw.set_window_size(glfw_utils.glfw_window_hello_imgui(), width, height)


def in_software(context: moderngl.Context) -> bool:
    """True if OpenGL runs on the processor, which it shares with the worker."""
    return any(name in context.info["GL_RENDERER"].lower() for name in ("llvmpipe", "softpipe", "swrast"))
