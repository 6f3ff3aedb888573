from dataclasses import replace
from pathlib import Path

import pytest

from viewer.values.preferences import LARGEST, SMALLEST, Preferences
from viewer.values.share_settings import ShareSettings


def test_saved_preferences_are_loaded(tmp_path: Path) -> None:
    settings = ShareSettings("picture", size=1024, background="colour", colour=(3, 255, 255))
    preferences = replace(Preferences(), dark=False, text=1.25, newcomer=False, share=settings)
    preferences = preferences.with_recent(tmp_path / "a.png")
    preferences.save(tmp_path / "deep" / "folder")
    assert Preferences.load(tmp_path / "deep" / "folder") == preferences


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "nonsense",
        '{"dark": 3, "text": null, "recent": 7}',
        '{"text": NaN, "recent": [1, {}], "other": 1}',
        '{"share": 3}',
        '{"share": {"kind": "poster", "size": 1024}}',
        '{"share": {"size": "large", "frames": null, "more": 1}}',
    ],
)
def test_invalid_preferences_have_their_defaults(text: str, tmp_path: Path) -> None:
    (tmp_path / "preferences.json").write_text(text)
    assert Preferences.load(tmp_path) == Preferences()


def test_text_stays_readable_and_recent_files_are_few_and_each_once(tmp_path: Path) -> None:
    assert Preferences().with_text_size(99.0).text == LARGEST
    assert Preferences().with_text_size(0.0).text == SMALLEST
    preferences = Preferences()
    for number in (*range(20), 15):
        preferences = preferences.with_recent(tmp_path / f"{number}.png")
    assert preferences.recent[:3] == tuple(str(tmp_path / f"{number}.png") for number in (15, 19, 18))
    assert len(preferences.recent) == len(set(preferences.recent)) == 8


def test_a_value_of_a_newer_version_leaves_the_others(tmp_path: Path) -> None:
    (tmp_path / "preferences.json").write_text('{"dark": false, "text": 1.5, "share": {"kind": "hologram"}}')
    assert Preferences.load(tmp_path) == Preferences(dark=False, text=1.5)
