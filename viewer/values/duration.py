"""Durations in words."""


def duration(seconds: float) -> str:
    """Format a duration in seconds or minutes, rounded as in speech.

    >>> [duration(seconds) for seconds in (0.2, 6.4, 38, 170, 4000)]
    ['1 s', '6 s', '40 s', '3 min', '67 min']
    """
    if seconds < 9.5:
        return f"{max(1, round(seconds))} s"
    return f"{5 * round(seconds / 5)} s" if seconds < 88 else f"{round(seconds / 60)} min"
