"""Small forms that several panels draw: a drop-down list, and how a film is to be written."""

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeVar

from imgui_bundle import hello_imgui, imgui

from viewer.activities.exporting import VideoChoice
from viewer.context import tip

T = TypeVar("T")
_FORMATS = {".mp4": "mp4", ".gif": "gif", ".webp": "webp", ".frames": "png frames"}
_SIZES = {size: f"{size} px" for size in (128, 256, 384, 512, 768, 1024)}
_RATES = {rate: f"{rate} fps" for rate in (12, 24, 30, 60)}


def choose(name: str, chosen: T, choices: Mapping[T, str], text: str, width: float = 7) -> T:
    """A drop-down list of few values (width in em)."""
    imgui.set_next_item_width(hello_imgui.em_size(width))
    if imgui.begin_combo(f"##{name}", choices.get(chosen, str(chosen))):
        for value, label in choices.items():
            if imgui.selectable(label, value == chosen)[0]:
                chosen = value
        imgui.end_combo()
    tip(text)
    return chosen


class VideoForm:
    """Format, size, rate, quality and ground of a film."""

    def __init__(self) -> None:
        self.suffix = ".mp4"
        self._choice = VideoChoice()

    @property
    def choice(self) -> VideoChoice:
        """What was chosen, as far as the format has it."""
        return replace(self._choice, transparent=self._choice.transparent and self.suffix != ".mp4")

    def draw(self) -> None:
        """Two lines."""
        choice = self._choice
        told = "mp4 is the smallest, gif plays everywhere; png frames are a folder of pictures"
        self.suffix = choose("format", self.suffix, _FORMATS, told)
        imgui.same_line()
        size = choose("video size", choice.size, _SIZES, "Width and height of the film")
        imgui.same_line()
        rate = choose("rate", choice.rate, _RATES, "Pictures a second", 5.5)
        imgui.begin_disabled(self.suffix == ".frames")
        imgui.set_next_item_width(hello_imgui.em_size(7))
        _, quality = imgui.slider_int(
            "##quality", choice.quality, 1, 100, "Quality %d", imgui.SliderFlags_.always_clamp
        )
        imgui.end_disabled()
        tip("More is sharper, and a larger file; png frames lose nothing")
        imgui.same_line()
        imgui.begin_disabled(self.suffix == ".mp4")
        _, clear = imgui.checkbox("No ground###transparent", self.choice.transparent)
        imgui.end_disabled()
        tip("Leave the ground out, so that what is behind shines through (gif, webp, png frames)")
        clear = choice.transparent if self.suffix == ".mp4" else clear
        self._choice = VideoChoice(size, rate, quality, clear)
