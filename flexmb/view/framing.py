"""What all pictures of one motion have in common, so that they can be compared and do not jump.

In: contents of some times of the motion. Out: a :class:`Framing` to compose all others with.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmb.view.content import Camera, Content, Scale

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Framing:
    """What stays the same through a motion.

    Parameters
    ----------
    size : float
        Of glyphs and links [m].
    exaggeration : float
        Factor on deformations.
    camera : Camera
        From where it is seen.
    box : (2, 3), optional
        What the view is fitted to, in the camera's axes, less the followed point.
    scale : Scale, optional
        Of the colours.
    digits : int
        Of the time, after the point.
    """

    size: float
    exaggeration: float
    camera: Camera
    box: Array | None = None
    scale: Scale | None = None
    digits: int | None = None


def common_box(contents: Sequence[Content], centers: Sequence[Array]) -> Array:
    """(2, 3) what all contents lie in, in camera axes, each seen from its centre (3,)."""
    spans = [
        np.stack(content.extent()) - content.camera.axes @ center
        for content, center in zip(contents, centers, strict=True)
    ]
    return np.stack([np.min(spans, axis=0)[0], np.max(spans, axis=0)[1]])


def largest_scale(scales: Iterable[Scale | None]) -> Scale | None:
    """The colour scale of the greatest value."""
    shown = [scale for scale in scales if scale is not None]
    return max(shown, key=lambda scale: scale.largest, default=None)
