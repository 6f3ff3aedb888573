"""Words of the command line that were renamed. They are still accepted, and help shows the new ones only."""

from collections.abc import Sequence

_COMMANDS: dict[tuple[str, ...], tuple[str, ...]] = {
    ("glance",): ("train-viewpoint",),
    ("bench", "parts"): ("bench", "ablations"),
    ("bench", "size"): ("bench", "model-size"),
    ("bench", "stability"): ("bench", "robustness"),
    ("dataset", "swap"): ("dataset", "pairs"),
}
_OPTIONS: dict[tuple[str, ...], dict[str, str]] = {
    ("fit",): {"--lens": "--estimate-focal"},
    ("train",): {"--from": "--init"},
    ("evaluate",): {"--swap": "--disentanglement", "--inputs": "--input-views", "--every": "--view-stride"},
    ("dataset", "pairs"): {"--blocks": "--tables"},
}
_VALUES: dict[tuple[str, ...], dict[tuple[str, str], str]] = {("train",): {("--recipe", "ours"): "default"}}


def current_words(arguments: Sequence[str]) -> list[str]:
    """The arguments with today's words in place of those that were renamed.

    >>> current_words(["dataset", "swap", "--blocks=2"])
    ['dataset', 'pairs', '--tables=2']
    """
    command, rest = _split_command(arguments)
    options, values = _OPTIONS.get(command, {}), _VALUES.get(command, {})
    words: list[str] = list(command)
    for word in rest:
        option, equals, value = word.partition("=")
        option = options.get(option, option)
        if equals:
            words.append(f"{option}={values.get((option, value), value)}")
        else:
            words.append(values.get((words[-1], word), option) if words else option)
    return words


def _split_command(arguments: Sequence[str]) -> tuple[tuple[str, ...], list[str]]:
    """The command of one or two words, by its name today, and what follows it."""
    for length in (2, 1):
        command = tuple(arguments[:length])
        command = _COMMANDS.get(command, command)
        if command in _OPTIONS or command in _VALUES or command in _COMMANDS.values():
            return command, list(arguments[length:])
    return (), list(arguments)
