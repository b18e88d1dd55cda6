"""Colours of pictures and plots, in one place."""

from __future__ import annotations

from typing import Final

__all__ = ["BODIES", "COLORMAP", "GHOST", "GROUND", "INK", "JOINT", "LINES", "PAPER"]

PAPER: Final = "#fbfbf9"
INK: Final = "#2b2f36"
GHOST: Final = "#6b7280"
GROUND: Final = "#c9c5bb"
JOINT: Final = "#e07b24"
COLORMAP: Final = "viridis"

# Bodies in the order of the scene: muted and far apart in hue and lightness, none close to the
# colour map's ends or to the joints. Lines of plots: the Okabe-Ito palette, safe for colour-blind
# readers (M. Okabe and K. Ito, Color Universal Design, 2008), its yellow left out.
BODIES: Final = ("#7d93b2", "#b59f86", "#93ab8f", "#b08fa3", "#8aa8a8", "#a8a08a")
LINES: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000")
