import json
from dataclasses import replace
from functools import partial

import pytest

from viewer.services.messages import UNFORESEEN, Button, MessageKind, Messages, error_text
from viewer.session import Session


def test_errors_stay_and_are_reported_once(session: Session) -> None:
    for number in (1, 2, 2, 3, 4, 5, 6):
        session.messages.notify(f"wrong {number}", MessageKind.PROBLEM)
        session.messages.notify(f"news {number}")
    assert session.messages.errors == [f"wrong {number}" for number in range(1, 7)]
    assert [message.text for message in session.messages.all if message.kind is MessageKind.DONE] == [
        f"news {n}" for n in (3, 4, 5, 6)
    ]


def test_at_most_two_errors_are_shown_and_they_go_by_themselves() -> None:
    messages = Messages()
    for number in range(4):
        messages.notify(f"wrong {number}", MessageKind.PROBLEM)
    assert [message.text for message in messages.shown] == ["wrong 2", "wrong 3"]
    messages.all = [replace(message, born=message.born - 60) for message in messages.all]
    assert messages.shown == []
    assert len(messages.errors) == len(messages.log) == 4


@pytest.mark.parametrize(
    ("more", "seconds"),
    [
        ({}, 5),
        ({"kind": MessageKind.NOTE}, 10),
        ({"kind": MessageKind.PROBLEM}, 10),
        ({"buttons": (Button("Undo", lambda: None),), "passing": True}, 10),
    ],
)
def test_a_message_fades_with_time(more: dict, seconds: float) -> None:
    messages = Messages()
    messages.notify("news", **more)
    (message,) = messages.shown
    assert not replace(message, born=message.born - seconds + 1).faded
    assert replace(message, born=message.born - seconds - 1).faded


def test_only_the_newest_passing_offer_is_shown() -> None:
    messages = Messages()
    for number in range(3):
        messages.notify(f"removed {number}", buttons=(Button("Undo", lambda: None),), passing=True)
    assert [message.text for message in messages.shown] == ["removed 2"]


def test_offers_outlast_time_and_news_while_they_are_relevant() -> None:
    messages = Messages()
    relevant = dict.fromkeys(range(6), True)
    for number in relevant:
        show = Button("Show", lambda: None)
        messages.notify(f"offer {number}", buttons=(show,), relevant=partial(relevant.__getitem__, number))
    assert [message.text for message in messages.shown] == ["offer 3", "offer 4", "offer 5"]
    relevant[4] = False
    assert [message.text for message in messages.shown] == ["offer 2", "offer 3", "offer 5"]
    messages = Messages()
    messages.notify("restore it?", buttons=(Button("Show", lambda: None),))
    messages.all = [replace(message, born=message.born - 3600) for message in messages.all]
    for number in range(9):
        messages.notify(f"news {number}")
    assert messages.shown[0].text == "restore it?"


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (ValueError("no such image: /home/me/my photos/chair.png"), "no such image: chair.png"),
        (ValueError(r"C:\Users\me\a.json is not a scene file"), "a.json is not a scene file"),
        (FileNotFoundError(2, "No such file or directory", "/a/folder/b.json"), "b.json: no such file or directory"),
        (KeyError("model"), UNFORESEEN),
        (json.JSONDecodeError("Expecting value", "", 0), "the file is damaged, or of another kind"),
    ],
)
def test_errors_are_said_in_plain_words(error: Exception, text: str) -> None:
    assert error_text(error) == text
