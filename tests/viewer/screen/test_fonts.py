from pathlib import Path

import pytest
from imgui_bundle import imgui

from tests.viewer.driver import Driver, in_window
from viewer.screen.fonts import SYSTEM, fallbacks
from viewer.values.printable import printable

NAMES = ("Größe", "Стул у окна", "Καρέκλα", "🪑 sofa 🚗 ❤️ 👍")


@in_window()
def test_names_of_many_languages_have_glyphs(window: Driver) -> None:
    font = imgui.get_font()
    for name in NAMES:
        missing = [sign for sign in printable(name) if not sign.isspace() and not font.is_glyph_in_font(ord(sign))]
        assert not missing, name
    if len(fallbacks()) > 1:
        assert all(font.is_glyph_in_font(ord(sign)) for sign in "椅子いす")


def test_a_font_of_the_system_is_taken_where_there_is_one(tmp_path: Path) -> None:
    emoji, *packaged = fallbacks(())
    assert emoji.is_file()
    if packaged:
        pytest.skip("the extra cjk is installed, and comes first")
    (tmp_path / "han.ttc").touch()
    assert fallbacks([str(tmp_path / "none.ttc"), str(tmp_path / "han.ttc")]) == [emoji, tmp_path / "han.ttc"]
    assert len(set(SYSTEM)) == len(SYSTEM)
