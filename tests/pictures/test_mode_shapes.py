"""Pictures of the modes of a machine: one per mode, displaced where the mode moves it."""

from __future__ import annotations

import numpy as np
from restscenes import chain

import flexmb


def test_a_picture_and_a_vibration_for_each_mode(tmp_path):
    made = flexmb.linearize(chain())
    pictures = flexmb.render_mode_shapes(made, tmp_path, [1, 2, 9])
    assert [path.name for path in pictures] == ["mode_1.png", "mode_2.png"]
    assert all(path.stat().st_size > 5000 for path in pictures)
    rows = flexmb.load_result(tmp_path / "mode_1.h5")
    moved = rows.q[:, ::7] - made.state.q[::7]
    shape = np.sin(np.arange(1, 5) * np.pi / 5)
    np.testing.assert_allclose(moved[0] / moved[0, 0], shape / shape[0], rtol=1e-9)
    np.testing.assert_allclose(moved[12], -moved[0], atol=1e-12)
