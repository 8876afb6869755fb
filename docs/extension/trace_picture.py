"""A small chart as SVG within the page, in its colours, so that it is light or dark as the page is."""

from __future__ import annotations

import html
import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

WIDTH, HEIGHT = 300, 200
LEFT, RIGHT, TOP, BOTTOM = 50, 292, 26, 160


def ticks(low: float, high: float, most: int) -> list[float]:
    """Return round numbers within a range."""
    raw = (high - low) / most
    size = 10.0 ** math.floor(math.log10(raw))
    step = next(size * k for k in (1, 2, 5, 10) if size * k >= raw)
    return [k * step for k in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)]


def words(number: float) -> str:
    """Write the number of a tick."""
    return f"{number:.4g}".replace("-", "−")


def picture(title: str, along: str, points: Sequence[tuple[float, float, float]], noise: float) -> str:
    """Draw the means of a residual along a driver.

    Parameters
    ----------
    title, along : str
        What is drawn, and against what, with their units.
    points : sequence of (float, float, float)
        Place along the driver, mean, and half the length of its bar.
    noise : float
        Half the height of the band about zero.

    Returns
    -------
    str
        An element of HTML.
    """
    xs = [x for x, _, _ in points]
    reach = 1.08 * max(noise, *(abs(y) + bar for _, y, bar in points))
    # A driver of two or three values keeps away from the frame.
    margin = 0.04 * (max(xs) - min(xs))
    low, high = min(xs) - margin, max(xs) + margin

    def across(x: float) -> float:
        return LEFT + (x - low) / (high - low) * (RIGHT - LEFT)

    def up(y: float) -> float:
        return (TOP + BOTTOM) / 2 - y / reach * (BOTTOM - TOP) / 2

    line = " ".join(f"{across(x):.1f},{up(y):.1f}" for x, y, _ in points)
    bars = "".join(
        f'<path class="bar" d="M{across(x):.1f} {up(y - bar):.1f}V{up(y + bar):.1f}"/>'
        f'<circle cx="{across(x):.1f}" cy="{up(y):.1f}" r="3"/>'
        for x, y, bar in points
    )
    marks = "".join(
        f'<text x="{across(x):.1f}" y="{BOTTOM + 15}" text-anchor="middle">{words(x)}</text>'
        for x in ticks(low, high, 4)
    ) + "".join(
        f'<text x="{LEFT - 6}" y="{up(y) + 4:.1f}" text-anchor="end">{words(y)}</text>'
        for y in ticks(-reach, reach, 4)
    )
    label = html.escape(f"{title}, measured less predicted, against {along}")
    return (
        f'<svg class="trace" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{label}">'
        f'<text class="title" x="{LEFT}" y="16">{html.escape(title)}</text>'
        f'<path class="noise" d="M{LEFT} {up(noise):.1f}H{RIGHT}V{up(-noise):.1f}H{LEFT}"/>'
        f'<path class="zero" d="M{LEFT} {up(0):.1f}H{RIGHT}"/>'
        f'<rect class="frame" x="{LEFT}" y="{TOP}" width="{RIGHT - LEFT}" height="{BOTTOM - TOP}"/>'
        f'<polyline points="{line}"/>{bars}{marks}'
        f'<text x="{(LEFT + RIGHT) / 2}" y="{HEIGHT - 6}" text-anchor="middle">{html.escape(along)}</text>'
        "</svg>"
    )
