"""The window's fonts: text with icons, and fallbacks for emoji and East Asian scripts."""

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

import imgui_bundle
from imgui_bundle import hello_imgui, imgui

from viewer.screen.theme import SIZE

_TEXT, _BOLD = "fonts/Roboto/Roboto-Regular.ttf", "fonts/Roboto/Roboto-Bold.ttf"
"""Assets of imgui_bundle with digits of equal width, Latin, Greek and Cyrillic."""
_EMOJI = Path(imgui_bundle.__file__).parent / "demos_assets/fonts/NotoEmoji-Regular.ttf"
_PACKAGE, _PACKAGED = "cvttf_NotoSansCJK_Regular", "NotoSansCJKtc-Regular.otf"  # package and file of the extra ``cjk``
SYSTEM = (
    "/usr/share/fonts/opentype/noto/NotoSansCJK-Regular.ttc",
    "/usr/share/fonts/google-noto-cjk/NotoSansCJK-Regular.ttc",
    "/usr/share/fonts/noto-cjk/NotoSansCJK-Regular.ttc",
    "/usr/share/fonts/truetype/droid/DroidSansFallbackFull.ttf",
    "/usr/share/fonts/truetype/wqy/wqy-microhei.ttc",
    "/System/Library/Fonts/Hiragino Sans GB.ttc",
    "/System/Library/Fonts/Supplemental/Arial Unicode.ttf",
    "C:/Windows/Fonts/msyh.ttc",
    "C:/Windows/Fonts/YuGothM.ttc",
    "C:/Windows/Fonts/malgun.ttf",
)  # systems' fonts with Chinese, Japanese or Korean; those with most glyphs first


def load_fonts() -> imgui.ImFont:
    """Load the font of text, and return the bold one of headings."""
    hello_imgui.load_font_ttf_with_font_awesome_icons(_TEXT, SIZE)
    merged = hello_imgui.FontLoadingParams(inside_assets=False, merge_to_last_font=True)
    for path in fallbacks():  # large, and for the text alone: headings hold no file names
        hello_imgui.load_font(str(path), SIZE, merged)
    return hello_imgui.load_font_ttf_with_font_awesome_icons(_BOLD, SIZE)


def fallbacks(system: Sequence[str] = SYSTEM) -> list[Path]:
    """Return the paths of fallback fonts: emoji, then Chinese, Japanese and Korean if available."""
    spec = find_spec(_PACKAGE)
    packaged = [Path(folder) / _PACKAGED for folder in (spec.submodule_search_locations or () if spec else ())]
    return [_EMOJI, *[path for path in (*packaged, *map(Path, system)) if path.is_file()][:1]]
