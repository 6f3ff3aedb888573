from itertools import pairwise

from viewer.values.quality import QUALITIES


def test_finer_is_more_work_every_time() -> None:
    work = [quality.detail**2 * quality.samples for quality in QUALITIES]
    assert all(1.3 < after / before < 4 for before, after in pairwise(work))
