"""``codenerf-viewer`` or ``python -m viewer``: the window, or an image of it without a display."""

import argparse
import sys
from collections.abc import Sequence
from contextlib import closing
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from core.runtime.folders import config_folder, is_temporary
from core.runtime.pipes import as_file
from core.runtime.program import program_name
from core.runtime.signals import on_signals
from core.runtime.threads import use_one_torch_thread, use_threads
from viewer.screen import window
from viewer.screen.splash import Splash
from viewer.screen.window import NoDisplayError
from viewer.services.memory import keep_little_free_memory, return_free_memory
from viewer.services.single_instance import SingleInstance, Start, begin, display_name
from viewer.services.worker import Worker

if TYPE_CHECKING:
    from viewer.session import Session

_LONGEST = 900.0  # limit in s of the work that an image of the window waits for


def main(arguments: Sequence[str] | None = None) -> None:
    """Open the window, or raise the open one. Without a display, end with one line on stderr and status 1."""
    keep_little_free_memory()
    use_one_torch_thread()
    on_signals()
    args = parser().parse_args(arguments)
    use_threads(args.threads)
    try:
        if args.screenshot is not None:
            _run(args)
            return
        image = str(args.image.absolute()) if args.image else ""
        folder = config_folder()
        instance = begin(folder, Start(image, _found_again(args.model or "")))
        if instance is None:
            print(f"{window.NAME} is open already: its window was raised")
            return
        with closing(instance):
            _run(args, folder, instance)
    except (NoDisplayError, ImportError, OSError, ValueError) as error:
        sys.exit(f"{program_name('viewer', 'codenerf-viewer')}: {error}")


def _run(args: argparse.Namespace, folder: Path | None = None, instance: SingleInstance | None = None) -> None:
    """Run a window that keeps its work in ``folder``; without ``instance``, save an image of an invisible one."""
    headless = instance is None
    worker = Worker(at_rest=return_free_memory)
    try:
        begin_session = partial(_session, args, folder, worker)
        if not headless:
            window.prepare(headless=False)
        session = begin_session() if headless else Splash(begin_session).run()
        # Imported late, so that `--help`, a wrong argument and the splash appear before torch is loaded.
        from viewer.app import App
        from viewer.screenshot import save_screenshot
        from viewer.services.messages import OK, MessageKind

        app = App(session, args.size, folder, headless, instance=instance)
        if folder and is_temporary(folder):
            text = f"No home folder takes files: this session is kept in {folder}"
            session.messages.notify(text, MessageKind.NOTE, buttons=OK)
        if args.model:
            session.show_model(_found_again(args.model))
        if args.image:
            app.context.fit(args.image)
        if headless:
            save_screenshot(app, args.screenshot, _LONGEST)
        else:
            app.run()
    finally:
        worker.close()
    if headless and (failed := session.messages.errors):
        sys.exit(f"{program_name('viewer', 'codenerf-viewer')}: {failed[-1]}")


def _session(args: argparse.Namespace, folder: Path | None, worker: Worker) -> "Session":
    """Return a new session; importing torch and opening the models take seconds."""
    import_module("viewer.app")
    from core.models.library import DEFAULT_MODEL, load_model
    from viewer.services.backend import Backend
    from viewer.session import Session

    backend = Backend(partial(load_model, device=args.device))
    return Session(worker, backend, None, folder, _found_again(args.model or "") or DEFAULT_MODEL, display_name())


def _found_again(model: str) -> str:
    """Return a shipped model's name unchanged, and a path as an absolute one."""
    path = Path(model)
    return str(path.resolve()) if path.is_file() else model


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    words = argparse.ArgumentParser(
        prog=program_name("viewer", "codenerf-viewer"),
        description="Opens the window, or raises the one that is open; without a display, renders it into an image.",
        allow_abbrev=False,
    )
    words.add_argument("--model", help="show an object of this model: a shipped name, or the path of a model file")
    words.add_argument("--device", choices=("cpu", "cuda"), default="cpu", help="where the network runs (cpu)")
    words.add_argument("--threads", type=_count, metavar="N", help="threads that compute (default: one for each core)")
    words.add_argument("--image", type=_image, help="fit this photo at once")
    words.add_argument("--screenshot", type=_png, metavar="PNG", help="render the window with no display, save it, end")
    words.add_argument("--size", type=_size, metavar="WxH", help="of the window (most of the screen; image: 1280x800)")
    return words


def _count(text: str) -> int:
    if not (text.isdecimal() and int(text)):
        raise argparse.ArgumentTypeError(f"at least one thread computes; got {text!r}")
    return int(text)


def _image(text: str) -> Path:
    if text.startswith(("http://", "https://")):
        raise argparse.ArgumentTypeError(f"{text} is an address: save the image from there, and give its path")
    path = as_file(Path(text))
    if not path.is_file():
        raise argparse.ArgumentTypeError(f"no such image: {text}")
    return path


def _png(text: str) -> Path:
    path = Path(text)
    if path.suffix.lower() != ".png" or not path.absolute().parent.is_dir():
        raise argparse.ArgumentTypeError(f"a screenshot is a .png in a folder that is there; got {text!r}")
    return path


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.lower().partition("x")
    if not (width.isdigit() and height.isdigit() and 320 <= int(width) <= 8192 and 240 <= int(height) <= 8192):
        raise argparse.ArgumentTypeError(f"a size is written 1280x800, and 320x240 at least; got {text!r}")
    return int(width), int(height)


if __name__ == "__main__":
    main()
