"""The command line, ``codenerf COMMAND`` or ``python -m core COMMAND``."""

import sys
import time
from collections.abc import Sequence
from importlib import import_module

from core.cli.output import lasting_output, say
from core.cli.parser import parse
from core.runtime.signals import on_signals
from core.runtime.threads import use_one_torch_thread, use_threads

_OF_THE_LABORATORY = ("pandas", "matplotlib")  # packages of the extra `lab`


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one command. Bad input ends with one line on stderr and status 2."""
    began = time.perf_counter()
    use_one_torch_thread()
    on_signals()
    with lasting_output():
        args = parse(sys.argv[1:] if arguments is None else arguments)
        args.began = began
        use_threads(args.threads)
        module, _, name = args.run.partition(".")
        try:
            # Imported late, so that a command loads only its own modules.
            getattr(import_module(f"core.cli.{module}"), name)(args)
        except (ValueError, OSError) as error:
            say(" ".join(str(error).split()))
            sys.exit(2)
        except ModuleNotFoundError as error:
            if error.name not in _OF_THE_LABORATORY:
                raise
            say(f"this command needs {error.name}: pip install 'codenerf-viewer[lab]'")
            sys.exit(2)
        except KeyboardInterrupt:
            sys.exit(130)


if __name__ == "__main__":
    main()
