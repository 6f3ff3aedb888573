"""How a video is written: a small form that several panels draw."""

from dataclasses import replace

from imgui_bundle import hello_imgui, imgui

from core.export.video import FORMATS, VideoSettings
from viewer.widgets.controls import choose, tooltip

_FORMATS = {suffix: one.label for suffix, one in FORMATS.items()}
_SIZES = {size: f"{size} px" for size in (128, 256, 384, 512, 768, 1024)}
_RATES = {rate: f"{rate} fps" for rate in (12, 24, 30, 60)}


class VideoForm:
    """Format, size, rate, quality and background of a video."""

    def __init__(self) -> None:
        self.suffix = ".mp4"
        self._options = VideoSettings()

    @property
    def options(self) -> VideoSettings:
        """What was chosen, as far as the format has it."""
        return replace(self._options, transparent=self._options.transparent and FORMATS[self.suffix].transparent)

    def draw(self) -> None:
        """Two lines."""
        options = self._options
        text = "mp4 is the smallest, gif plays everywhere; png frames are a folder of images"
        self.suffix = choose("format", self.suffix, _FORMATS, text)
        imgui.same_line()
        size = choose("video size", options.size, _SIZES, "Width and height of the video")
        imgui.same_line()
        rate = choose("rate", options.rate, _RATES, "Frames per second", 5.5)
        imgui.begin_disabled(FORMATS[self.suffix].folder)
        imgui.set_next_item_width(hello_imgui.em_size(7))
        _, quality = imgui.slider_int(
            "##quality", options.quality, 1, 100, "Quality %d", imgui.SliderFlags_.always_clamp
        )
        imgui.end_disabled()
        tooltip("More is sharper, and a larger file; png frames lose nothing")
        imgui.same_line()
        imgui.begin_disabled(not FORMATS[self.suffix].transparent)
        _, clear = imgui.checkbox("Transparent background###transparent", self.options.transparent)
        imgui.end_disabled()
        tooltip("Leave the background out, so that what is behind shines through (gif, webp, png frames)")
        clear = clear if FORMATS[self.suffix].transparent else options.transparent
        self._options = VideoSettings(size, rate, quality, clear)
