"""Contrast of the console's two themes, by the Web Content Accessibility Guidelines 2.2 (1.4.3, 1.4.6, 1.4.11)."""

import re

import pytest
from tests.console.conftest import STATIC

WORDS = ["text", "muted", "accent", "ok", "warn", "danger"]
DRAWN = ["line", "track", "plan", "truth", "reference", "predicted", "water", "seen"]
NEEDED = {"dark": (4.5, 3.0), "daylight": (7.0, 4.5)}  # of words, of what is drawn


def themes() -> dict[str, dict[str, str]]:
    source = (STATIC / "theme.css").read_text()
    blocks = re.findall(r"^(body[.\w]*) \{(.*?)^\}", source, re.MULTILINE | re.DOTALL)
    dark, daylight = (dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6})", block)) for _, block in blocks)
    return {"dark": dark, "daylight": dark | daylight}


def luminance(colour: str) -> float:
    shares = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    r, g, b = (share / 12.92 if share <= 0.04045 else ((share + 0.055) / 1.055) ** 2.4 for share in shares)
    return 0.2126 * r + 0.7152 * g + 0.0722 * b


def contrast(a: str, b: str) -> float:
    low, high = sorted([luminance(a), luminance(b)])
    return (high + 0.05) / (low + 0.05)


def test_contrast_of_black_and_white():
    assert contrast("#000000", "#ffffff") == pytest.approx(21)
    assert contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.005)


@pytest.mark.parametrize("theme", NEEDED)
@pytest.mark.parametrize("behind", ["bg", "panel"])
def test_words_and_drawings_stand_out(theme: str, behind: str):
    colours = themes()[theme]
    words, drawn = NEEDED[theme]
    weak = {name: contrast(colours[name], colours[behind]) for name in WORDS if name in colours}
    assert len(weak) == len(WORDS) and min(weak.values()) >= words, weak
    faint = {name: contrast(colours[name], colours[behind]) for name in DRAWN}
    assert min(faint.values()) >= drawn, faint


@pytest.mark.parametrize("theme", NEEDED)
def test_words_on_coloured_buttons_and_over_the_picture(theme: str):
    colours = themes()[theme]
    for name in ["accent", "ok", "warn", "danger"]:
        assert contrast(colours["on-accent"], colours[name]) >= 4.5, name
    for name in ["hud", "hud-muted", "hud-ok", "hud-warn", "hud-danger", "hud-reference"]:
        assert contrast(colours[name], colours["video"]) >= 7, name
