from collections.abc import Iterator

import pytest

from tests.viewer.driver import deliver, finish
from viewer.services.latest import Latest
from viewer.session import Session


@pytest.fixture
def latest(session: Session) -> Latest[int, str]:
    return Latest(session.jobs, "words", "Cannot find words", silent=ValueError)


def counted(number: int, made: list[int]) -> Iterator[str]:
    """Yield a coarse value, then a better one."""
    made.append(number)
    yield from (f"{number}?", str(number))


def test_the_worker_is_asked_once_for_each_new_inputs(session: Session, latest: Latest[int, str]) -> None:
    made = list[int]()

    def ask(number: int, asks: bool = True) -> str | None:
        return latest.of(number, lambda: counted(number, made), asks)

    assert ask(1, asks=False) is None and latest.current is None
    finish(session, lambda: ask(1) == "1")
    assert ask(2, asks=False) is None and latest.current == "1"
    assert ask(2) is None
    assert (latest.value, latest.inputs, latest.current) == ("1", 1, None)  # to be shown meanwhile
    finish(session, lambda: latest.current == "2")
    assert ask(2) == "2" and made == [1, 2]
    latest.set(3, "three")
    assert ask(3) == "three" and made == [1, 2]
    latest.close()
    assert latest.current is None
    finish(session, lambda: ask(3) == "3")


def test_a_late_value_is_none_for_newer_inputs(session: Session) -> None:
    """An urgent job's first value is delivered though a newer one waits."""
    latest = Latest[int, str](session.jobs, "words", "Cannot find words", urgent=True)
    latest.of(1, lambda: ["1"])
    latest.of(2, lambda: ["2"])
    deliver(session, lambda: latest.value is not None)
    assert latest.current in (None, "2")
    finish(session, lambda: latest.current == "2")


@pytest.mark.parametrize(("error", "reported"), [(ValueError("no"), []), (OSError("no disk"), ["Cannot find words"])])
def test_an_error_is_no_value_and_not_tried_again(
    session: Session, latest: Latest[int, str], error: Exception, reported: list[str]
) -> None:
    tries = list[int]()

    def fail() -> Iterator[str]:
        tries.append(1)
        yield from ()
        raise error

    for _ in range(2):
        assert latest.of(1, fail) is None
        finish(session)
    assert [text.split(":")[0] for text in session.messages.errors] == reported and tries == [1]
