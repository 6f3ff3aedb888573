"""Colours and spacing of the dark and the light theme."""

from dataclasses import dataclass

from imgui_bundle import ImVec2, ImVec4, imgui, implot

Colour = tuple[float, float, float]  # sRGB, 0..1
SIZE = 16.0  # px of the text, before scaling to screen and preferences
HEADING, SMALL = 1.15, 0.84  # sizes of headings and captions, relative to the text
PLATE: Colour = (0.07, 0.08, 0.09)  # plate behind text over the view
ON_PLATE: Colour = (0.95, 0.95, 0.96)  # text on that plate
PLATE_OPACITY = 0.88
WARM: Colour = (0.93, 0.63, 0.27)  # colour of object B; A has the accent


@dataclass(frozen=True)
class Palette:
    """The basic colours from which all others are derived."""

    back: Colour  # behind panels, and of menu bar and tabs
    panel: Colour
    raised: Colour  # buttons
    line: Colour  # borders
    text: Colour
    accent: Colour  # object A, and selections
    warm: Colour  # text about B, and warnings
    error: Colour
    background: tuple[Colour, Colour]  # behind the object: at the top and at the bottom of the view

    @property
    def quiet(self) -> Colour:
        """The colour of less important text."""
        return mixed(self.text, self.panel, 0.3)


DARK = Palette(
    back=(0.075, 0.082, 0.094),
    panel=(0.115, 0.124, 0.14),
    raised=(0.185, 0.2, 0.225),
    line=(0.2, 0.215, 0.24),
    text=(0.89, 0.9, 0.915),
    accent=(0.33, 0.64, 0.88),
    warm=WARM,
    error=(0.93, 0.43, 0.41),
    background=((0.93, 0.94, 0.95), (0.68, 0.7, 0.73)),
)
LIGHT = Palette(
    back=(0.86, 0.87, 0.885),
    panel=(0.955, 0.96, 0.968),
    raised=(0.885, 0.895, 0.91),
    line=(0.68, 0.7, 0.73),
    text=(0.12, 0.13, 0.15),
    accent=(0.16, 0.45, 0.76),
    warm=(0.6, 0.32, 0.0),
    error=(0.78, 0.2, 0.2),
    background=((0.99, 0.99, 1.0), (0.84, 0.85, 0.87)),
)


def mixed(first: Colour, second: Colour, amount: float) -> Colour:
    """Interpolate between two colours: ``amount`` 0 is the first, 1 the second."""
    red, green, blue = (a + (b - a) * amount for a, b in zip(first, second, strict=True))
    return red, green, blue


def contrast(first: Colour, second: Colour) -> float:
    """Return the contrast ratio of two colours, 1..21, as WCAG 2 defines it."""
    low, high = sorted((_luminance(first), _luminance(second)))
    return (high + 0.05) / (low + 0.05)


def on(colour: Colour) -> Colour:
    """Return black or white, whichever is easier to read on a colour."""
    dark = (0.04, 0.05, 0.06)
    light = (1.0, 1.0, 1.0)
    return dark if contrast(dark, colour) > contrast(light, colour) else light


def emphasised(colour: Colour) -> Colour:
    """Return a button's colour under the mouse: with more contrast to its text."""
    red, green, blue = on(colour)
    return mixed(colour, (1 - red, 1 - green, 1 - blue), 0.2)


def _luminance(colour: Colour) -> float:
    linear = (value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4 for value in colour)
    return sum(weight * value for weight, value in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


def packed(colour: Colour, opacity: float = 1.0) -> int:
    """Return a colour as the 32-bit number that imgui's draw lists take."""
    return imgui.color_convert_float4_to_u32(ImVec4(*colour, opacity))


def apply(palette: Palette) -> None:
    """Apply a palette to all widgets. The light theme has borders, as its shades are similar."""
    style = imgui.get_style()
    dark = sum(palette.panel) < 1.5
    (imgui.style_colors_dark if dark else imgui.style_colors_light)()
    style.frame_border_size = style.window_border_size = 0.0 if dark else 1.0
    for name, colour in colours(palette).items():
        style.set_color_(getattr(imgui.Col_, name), ImVec4(*colour, 1.0))
    style.set_color_(imgui.Col_.modal_window_dim_bg, ImVec4(*palette.back, 0.55))
    style.set_color_(imgui.Col_.text_selected_bg, ImVec4(*palette.accent, 0.35))
    style.set_color_(imgui.Col_.docking_preview, ImVec4(*palette.accent, 0.4))
    plots = implot.get_style()
    plots.plot_padding = ImVec2(6, 6)
    plots.plot_border_size = 0.0
    implot.style_colors_auto()


def colours(p: Palette) -> dict[str, Colour]:
    """Return the colours of widget parts by their names in imgui."""
    quiet = mixed(p.raised, p.panel, 0.35)
    lit = mixed(p.raised, p.text, 0.1)
    strong = mixed(p.raised, p.accent, 0.45)
    return {
        "text": p.text, "text_disabled": p.quiet,
        "window_bg": p.panel, "popup_bg": mixed(p.panel, p.raised, 0.4), "menu_bar_bg": p.back,
        "border": p.line, "separator": p.line, "separator_hovered": p.accent, "separator_active": p.accent,
        "frame_bg": quiet, "frame_bg_hovered": lit, "frame_bg_active": strong,
        "title_bg": p.back, "title_bg_active": p.back, "title_bg_collapsed": p.back,
        "button": p.raised, "button_hovered": mixed(p.raised, p.accent, 0.3), "button_active": strong,
        "header": mixed(p.raised, p.accent, 0.2), "header_hovered": mixed(p.raised, p.accent, 0.3),
        "header_active": strong, "check_mark": p.accent, "slider_grab": mixed(p.accent, p.panel, 0.45),
        "slider_grab_active": mixed(p.accent, p.panel, 0.3),
        "tab": p.back, "tab_hovered": p.raised, "tab_selected": p.panel,
        "tab_selected_overline": p.accent, "tab_dimmed": p.back, "tab_dimmed_selected": p.panel,
        "scrollbar_bg": p.panel, "scrollbar_grab": p.raised, "scrollbar_grab_hovered": lit,
        "plot_histogram": mixed(p.accent, p.panel, 0.45), "plot_lines": p.accent, "docking_empty_bg": p.back,
        "resize_grip": p.raised, "resize_grip_hovered": p.accent, "nav_cursor": p.accent,
    }  # fmt: skip


def set_spacing() -> None:
    """Set roundings and paddings in px at 96 ppi, which the runner scales to the screen."""
    style = imgui.get_style()
    style.window_padding = ImVec2(12, 10)
    style.frame_padding = ImVec2(9, 5)
    style.item_spacing = ImVec2(8, 7)
    style.item_inner_spacing = ImVec2(6, 4)
    style.window_rounding, style.frame_rounding, style.popup_rounding = 6, 5, 6
    style.grab_rounding, style.tab_rounding, style.child_rounding = 4, 5, 6
    style.scrollbar_rounding, style.scrollbar_size, style.grab_min_size = 6, 11, 11
    style.popup_border_size = 1
    style.tab_min_width_shrink = 44  # shows all tabs of a narrow panel, abbreviated
    style.tab_bar_border_size, style.docking_separator_size = 0, 3
    style.window_menu_button_position = imgui.Dir.none
    style.separator_text_border_size = 1
