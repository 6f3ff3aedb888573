import json
from dataclasses import replace

import pytest

from viewer.services.messages import OK, UNFORESEEN, Button, MessageKind, Messages, error_text
from viewer.session import Session


def test_errors_are_listed_once_also_after_they_faded(session: Session) -> None:
    for number in (1, 2, 2, 3):
        session.messages.notify(f"wrong {number}", MessageKind.PROBLEM)
        session.messages.notify(f"news {number}")
    assert session.messages.errors == ["wrong 1", "wrong 2", "wrong 3"]
    assert len(session.messages.log) == 8


@pytest.mark.parametrize("kind", MessageKind)
def test_the_newest_message_fades_after_eight_seconds(kind: MessageKind) -> None:
    messages = Messages()
    messages.notify("old news")
    messages.notify("news", kind)
    assert messages.newest is not None and messages.newest.text == "news"
    for seconds, faded in ((7, False), (9, True)):
        assert replace(messages.newest, born=messages.newest.born - seconds).faded == faded
    messages.all = [replace(message, born=message.born - 9) for message in messages.all]
    assert messages.newest is None


def test_an_offer_stays_until_it_is_replaced_and_what_is_to_be_read_comes_back() -> None:
    messages = Messages()
    is_relevant = True
    messages.notify("restored a damaged file", buttons=OK)
    messages.notify("offer", buttons=(Button("Show", lambda: None),), relevant=lambda: is_relevant)
    messages.all = [replace(message, born=message.born - 3600) for message in messages.all]
    assert messages.newest is not None and messages.newest.text == "offer"
    messages.notify("news")
    assert messages.newest.text == "news"
    messages.all = [replace(message, born=message.born - 9) for message in messages.all]
    assert messages.newest.text == "restored a damaged file"
    messages.dismiss(messages.newest)
    assert messages.newest is None
    messages.notify("offer", buttons=(Button("Show", lambda: None),), relevant=lambda: is_relevant)
    is_relevant = False
    assert messages.newest is None


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (ValueError("no such image: /home/me/my photos/chair.png"), "no such image: chair.png"),
        (ValueError("PNG / JPEG, 3/4 of it"), "PNG / JPEG, 3/4 of it"),
        (ValueError(r"C:\Users\me\a.json is not a scene file"), "a.json is not a scene file"),
        (FileNotFoundError(2, "No such file or directory", "/a/folder/b.json"), "b.json: no such file or directory"),
        (
            ValueError("/a/b.avif: not an image that can be read (Failed to decode frame 0: Decoding (8) failed)"),
            "b.avif: not an image that can be read: it is damaged, or of another kind",
        ),
        (KeyError("model"), UNFORESEEN),
        (json.JSONDecodeError("Expecting value", "", 0), "the file is damaged, or of another kind"),
        (FileNotFoundError(2, "No such file", "/photos/\udcff\u202e.png"), "?.png: no such file"),
        (PermissionError(13, "Denied", "a" * 9000), f"{'a' * 4096}: denied"),
    ],
)
def test_errors_are_said_in_plain_words(error: Exception, text: str) -> None:
    assert error_text(error) == text
