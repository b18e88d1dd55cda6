"""The motion does not depend on what the body frame is fixed at: orders of the difference."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from femeshes import line
from flexiblescenes import rod

import flexmb
from flexmb.fe import rectangle, reduce
from flexmb.flexbody.effects import frame_at_interface
from flexmb.flexbody.natural_modes import natural_modes
from flexmb.model import Model
from flexmb.model.markers import PlacedMarker
from flexmb.results.marker_history import marker_motion


@pytest.fixture(scope="module")
def frames():
    """A skew beam under a force and a moment at its tip, by its mean axis and by its root."""
    body = reduce(
        line(6, (0.1, -0.2, 0.3), (0.9, 0.5, 0.4)), material="steel", modes=6,
        interfaces={"root": "root", "tip": "tip"},
        sections={"all": rectangle(0.03, 0.05, orientation=(0, 0, 1))},
        loads={"push": {"type": "force", "node": 6, "force": [3, -5, 2], "moment": [0.4, 1, -2]}},
    )  # fmt: skip
    return body, frame_at_interface(body, "root")


def test_natural_frequencies_do_not_depend_on_the_frame(frames):
    """Free, and held at one end: the coupling of turns and modes is that of the frame."""
    for held in ((), ("tip",)):
        one, other = (natural_modes(body, held, None if held else np.zeros((0, 6 + body.m)))
                      .frequencies for body in frames)  # fmt: skip
        np.testing.assert_allclose(other, one, rtol=1e-7, atol=1e-5 * one.max())


def test_a_frame_at_an_interface_stays_with_it(frames):
    """Its interface neither moves nor turns; the other one as seen from it."""
    mean, held = frames
    root, tip = (held.interface(name) for name in ("root", "tip"))
    size = np.abs(mean.interface("tip").Phi_t).max()
    np.testing.assert_allclose(root.Phi_t, 0.0, atol=1e-9 * size)
    np.testing.assert_allclose(root.Phi_r, 0.0, atol=1e-9 * size)
    start, end = (mean.interface(name) for name in ("root", "tip"))
    arm = (end.position - start.position)[:, None]
    seen = end.Phi_t - start.Phi_t - np.cross(start.Phi_r, arm, axis=0)
    np.testing.assert_allclose(tip.Phi_t, seen, atol=1e-9 * size)


def test_a_load_acts_on_modes_as_its_node_moves(frames):
    """Force by displacement, moment by rotation, whatever the frame."""
    for body in frames:
        row, load = body.nodes.row(6), body.loads[0]
        wanted = [3, -5, 2] @ body.nodes.Phi_t[row] + [0.4, 1, -2] @ body.nodes.Phi_r[row]
        np.testing.assert_allclose(load.modal, wanted, atol=1e-9 * np.abs(wanted).max())


def test_one_interface_is_where_it_is_from_the_other_in_both_frames():
    """To second order: the place and the rotation of the tip in the axes of the root."""
    mesh, sections = line(10, end=(0.8, 0.6, 0)), {"all": rectangle(0.003, 0.04)}
    ends = {"root": "root", "tip": "tip"}
    body = reduce(mesh, material="steel", sections=sections, interfaces=ends, modes=4,
                  geometric_stiffening="full")  # fmt: skip
    assert np.abs(body.interface("root").bend[3:]).max() > 0.1
    shape = np.linalg.solve(body.K, body.interface("tip").Phi_t.T @ [0.3, -0.4, 300.0])
    shape *= 0.025 / np.abs(body.interface("tip").Phi_t @ shape).max()
    gaps = []
    for size in (1.0, 0.5):
        poses = []
        for framed in (body, frame_at_interface(body, "root")):
            eta = np.concatenate([[0, 0, 0, 1, 0, 0, 0], size * shape])[None]
            root, tip = (
                marker_motion(PlacedMarker("", part.position, np.zeros(3), np.eye(3),
                                           part.Phi_t, part.Phi_r, part.bend), eta)
                for part in framed.interfaces
            )  # fmt: skip
            R = root.axes[0]
            poses.append([R.T @ (tip.position - root.position)[0], *(R.T @ tip.axes[0]).T])
        gap = np.abs(np.subtract(*poses))
        gaps.append([gap[0].max(), gap[1:].max()])
    assert np.log2(np.divide(*gaps)) == pytest.approx(3.0, abs=0.2)


def spun_up(body, **words):
    """Tip of a beam that its hub turns ever faster, smoothly up to 32 rad/s."""
    made = Model("blade")
    made.add_body("beam", body, **words)
    made.add_joint("hub", "revolute", between=["ground", "beam.root"], axis="z")
    made.add_driver("motor", joint="hub", angle="1000*t**4")
    made.add_sensor("tip", "position", of="beam.tip")
    made.set_validity(speed="any")
    found = flexmb.simulate(
        made, duration=0.2, accuracy=1e-6, outputs=30, method="radau", verify=False
    )
    return np.array([found[f"tip.{axis}"] for axis in "xyz"])


@pytest.mark.parametrize("coupling", ["partial", "full"])
@pytest.mark.slow
def test_with_stiffening_both_frames_agree_to_a_higher_order(coupling):
    """Without it they differ with the square of the deflection, which falls with the stiffness."""
    body = rod(0.01, 1.0, 10, 4, geometric_stiffening="full")
    sizes, errors = [], {"none": [], "full": []}
    for stiffer in (4.0, 8.0):
        made = replace(body, K=stiffer * body.K)
        words = {"inertia_coupling": coupling}
        sizes.append(np.abs(spun_up(made, **words) - spun_up(made, deformation="rigid")).max())
        for stiffening, found in errors.items():
            words["geometric_stiffening"] = stiffening
            mean, held = (spun_up(made, frame=frame, **words)
                          for frame in ("mean axis", "interface root"))  # fmt: skip
            found.append(np.abs(mean - held).max())
    assert sizes[0] / sizes[1] == pytest.approx(2.0, rel=0.2)
    assert errors["none"][0] / errors["none"][1] == pytest.approx(4.0, rel=0.1)
    assert errors["full"][0] / errors["full"][1] == pytest.approx(8.0, rel=0.2)
    assert errors["full"][0] < 0.03 * errors["none"][0]


@pytest.mark.parametrize("coupling", ["constant", "partial", "full"])
def test_a_frame_that_needs_full_coupling_says_so(frames, coupling):
    """A driven bar with its frame at the free end: constant coupling diverges there."""
    model = Model("bar")
    model.add_body("bar", frames[0], frame="interface tip", inertia_coupling=coupling)
    words = model.bodies["bar"].effects_in_words()
    assert ("may diverge" in words) == (coupling != "full")
    model.add_body("other", frames[0], inertia_coupling=coupling)
    assert "may diverge" not in model.bodies["other"].effects_in_words()
