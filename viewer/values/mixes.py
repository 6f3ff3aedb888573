"""Mixes of objects A and B: the amount of B's shape grows to the right, of its texture upwards."""

from core.models.model import Instance

STEPS = 5  # mixes along each side


def mixes(a: Instance, b: Instance) -> dict[tuple[int, int], Instance]:
    """Return the mixes by column and row, counted from A in the lower left corner; the corners come first."""
    order = sorted(range(STEPS), key=lambda step: -abs(step - STEPS // 2))
    last = STEPS - 1
    return {(column, row): a.mixed(b, column / last, row / last) for row in order for column in order}
