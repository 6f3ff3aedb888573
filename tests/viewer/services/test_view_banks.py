from collections.abc import Generator
from itertools import zip_longest

import pytest

from core.models.model import Model
from core.photos.view_bank import ViewBank
from core.streams import run_to_end
from tests.core.tiny import tiny_bank, tiny_model
from viewer.services.view_banks import ViewBanks


class Builder:
    """Takes eight steps; counts them."""

    taken = 0

    def __call__(self, model: Model) -> Generator[float, None, ViewBank]:
        for step in range(8):
            self.taken += 1
            yield (step + 1) / 8
        return tiny_bank()


def test_jobs_share_the_work_and_continue_that_of_others():
    builder, model = Builder(), tiny_model()
    banks = ViewBanks(builder)
    turns = list(zip_longest(banks.wait(model), banks.wait(model)))
    assert (len(turns), builder.taken) == (4, 8)
    assert run_to_end(banks.wait(model)) is tiny_bank()
    assert builder.taken == 8
    builder, model = Builder(), tiny_model()
    banks = ViewBanks(builder)
    first = banks.wait(model)
    next(first), next(first)
    first.close()
    assert banks.shares == {model.fingerprint: 0.25}
    run_to_end(banks.wait(model))
    assert builder.taken == 8


def test_a_bank_that_failed_is_begun_anew():
    outcomes = [ValueError("no memory"), None]

    def build(model: Model) -> Generator[float, None, ViewBank]:
        if error := outcomes.pop(0):
            raise error
        yield 0.5
        return tiny_bank()

    banks = ViewBanks(build)
    with pytest.raises(ValueError, match="no memory"):
        run_to_end(banks.wait(tiny_model()))
    assert run_to_end(banks.wait(tiny_model())) is tiny_bank()
