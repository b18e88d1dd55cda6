"""Sensors against what they mean: rates against differences, angles against SciPy's rotations,
reactions and energies against what the engine stores of them."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from enginekit import Bench, rotation, slope
from generators import Mechanism
from scipy.spatial.transform import Rotation

from flexmb.model import Model

DIFFERENCES = 1e-9
LAST_DIGITS = 1e-12
SEQUENCES = [
    "".join(axes)
    for axes in itertools.product("xyz", repeat=3)
    if axes[0] != axes[1] and axes[1] != axes[2]
]
KINDS = ("position", "velocity", "acceleration")
SPINS = ("angular_velocity", "angular_acceleration")


def sensed(bodies):
    """A random chain with every kind of motion sensed between its flexible or rigid bodies."""
    made = Mechanism(7, "chain", bodies, n=3)
    model, rng = made.model, made.rng
    of, base = "b2.f2", "b0.f0"
    for kind in KINDS + SPINS:
        model.add_sensor(f"plain_{kind}", kind, of=of, relative_to=base)
        model.add_sensor(f"seen_{kind}", kind, of=of, seen_from=base)
        model.add_sensor(f"turned_{kind}", kind, of=of, relative_to="b1.f1", axes=base)
    ends = [made.marker(b, f"frame{b}", rng.standard_normal(3)) for b in (0, 2)]
    for n in range(3):
        model.add_sensor(f"distance{n}", "distance", between=[base, of], derivative=n)
        for kind in ("stroke", "angle"):
            model.add_sensor(f"{kind}{n}", kind, between=ends, axis=[1, 2, 2], derivative=n)
    return model


@pytest.fixture(scope="module", params=["rigid", "mixed"])
def moving(request):
    bench = Bench(sensed(request.param))
    bench.randomise(4)
    return bench


def channels(bench):
    return dict(zip(bench.layout.channels, bench.channels, strict=True))


def along(bench, names):
    """Time derivatives of channels along the motion that v and v̇ mean."""
    t, q, v, vd = bench.state.t[0], bench.q.copy(), bench.v.copy(), bench.vd.copy()

    def at(s):
        moved = bench.moved(q, s * v + 0.5 * s * s * vd)
        bench.state.angles[:] = before
        bench.at(t=t + s, q=moved, v=v + s * vd)
        found = channels(bench)
        return np.array([found[name] for name in names])

    bench.state.angles[:] = np.nan
    before = bench.at().state.angles.copy()
    found = slope(at, h=1e-3)
    bench.at(t=t, q=q, v=v)
    return found


def vector(name):
    return [f"{name}.{axis}" for axis in "xyz"]


@pytest.mark.parametrize("how", ["plain", "seen"])
def test_motions_are_derivatives_of_each_other(moving, how):
    """In global axes, and as an observer on a turning marker sees them."""
    for first, second in itertools.pairwise(KINDS):
        rates = along(moving, vector(f"{how}_{first}"))
        wanted = [channels(moving)[name] for name in vector(f"{how}_{second}")]
        np.testing.assert_allclose(rates, wanted, atol=1e-7 * np.abs(wanted).max())
    rates = along(moving, vector(f"{how}_{SPINS[0]}"))
    wanted = [channels(moving)[name] for name in vector(f"{how}_{SPINS[1]}")]
    np.testing.assert_allclose(rates, wanted, atol=1e-7 * np.abs(wanted).max())


@pytest.mark.parametrize("kind", ["distance", "stroke", "angle"])
def test_coordinates_have_their_rates(moving, kind):
    rates = along(moving, [f"{kind}0", f"{kind}1"])
    found = channels(moving)
    np.testing.assert_allclose(rates, [found[f"{kind}1"], found[f"{kind}2"]], rtol=1e-7)


def test_both_angles_of_a_universal_joint():
    """Bent about one axis after the other, the cross between them: both angles, and their signs."""
    model = Model("universal")
    model.add_body("shaft", mass=1, inertia=[1, 1, 1])
    model.add_joint("cross", "universal", between=["ground", "shaft"], axis="x", second_axis="y")
    model.add_sensor("first", "angle", joint="cross")
    model.add_sensor("second", "second_angle", joint="cross")
    model.add_driver("turn", joint="cross", second_angle=0.3)
    bench = Bench(model)
    for first, second in ((0.5, 0.3), (-0.2, 0.3), (0.4, -1.0)):
        bench.state.angles[:] = np.nan
        turned(bench, Rotation.from_euler("XY", [first, second]).as_matrix())
        found = channels(bench)
        assert found["first"] == pytest.approx(first, abs=1e-12)
        # as the driver of this coordinate measures it
        assert bench.C[-1] == pytest.approx(found["second"] - 0.3, abs=1e-12)
        assert found["second"] == pytest.approx(second, abs=1e-12)


def test_axes_of_a_marker_turn_components_only(moving):
    """The difference of global velocities, in the axes of a third marker."""
    bench = moving.at()
    terms = bench.sys.sensors.terms
    channel = bench.layout.channels.index("turned_velocity.x")
    first = int(bench.sys.sensors.channels[channel]["first"])
    axes, j, i = terms[first]["I"], terms[first]["J"], terms[first + 1]["J"]
    R, vx = bench.marker("R")[axes], bench.marker("vx")
    wanted = R.T @ (vx[j] - vx[i])
    found = [channels(bench)[name] for name in vector("turned_velocity")]
    np.testing.assert_allclose(found, wanted, atol=LAST_DIGITS * np.abs(wanted).max())


def free(**sensors):
    model = Model("free body")
    model.add_body("body", mass=1, inertia=[1, 1, 1])
    for name, fields in sensors.items():
        model.add_sensor(name, **fields)
    return model


def turned(bench, R):
    """The bench with its body at this orientation."""
    x, y, z, w = Rotation.from_matrix(R).as_quat()
    bench.q[3:7] = w, x, y, z
    return bench.at()


@pytest.fixture(scope="module")
def turning():
    """One body with the angles of all sequences."""
    return Bench(
        free(**{s: {"type": "orientation", "of": "body", "sequence": s} for s in SEQUENCES})
    )


def test_angles_of_all_sequences_are_those_of_scipy(turning):
    assert len(SEQUENCES) == 12
    for R in Rotation.random(10, random_state=3):
        turning.state.angles[:] = np.nan
        found = turned(turning, R.as_matrix()).channels.reshape(-1, 3)
        wanted = [R.as_euler(sequence.upper()) for sequence in SEQUENCES]
        np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_angles_go_on_over_turns_and_through_singular_poses(turning):
    """Given three angles that grow through many turns, each sequence gives them back."""
    turning.state.angles[:] = np.nan
    for k, sequence in enumerate(SEQUENCES):
        middle = 0.3 if sequence[0] == sequence[2] else 0.1
        before = None
        for s in np.linspace(0.0, 1.0, 60):
            given = np.array([20.0 * s, middle + 3.0 * np.sin(5.0 * s), -15.0 * s])
            R = Rotation.from_euler(sequence.upper(), given).as_matrix()
            found = turned(turning, R).channels[3 * k : 3 * k + 3]
            assert before is None or np.abs(found - before).max() < 1.0
            before = found
            np.testing.assert_allclose(found, given, atol=1e-7)
        turning.state.angles[:] = np.nan


@pytest.mark.parametrize("sequence, beta", [("xyz", np.pi / 2), ("zxz", 0.0), ("zyz", np.pi)])
def test_at_a_singular_pose_gamma_stays_and_the_turn_is_whole(turning, sequence, beta):
    k = 3 * SEQUENCES.index(sequence)
    for off in (1e-3, 0.0):
        R = Rotation.from_euler(sequence.upper(), [0.4, beta - off if beta else off, 0.7])
        if off:
            turning.state.angles[:] = np.nan
        found = turned(turning, R.as_matrix()).channels[k : k + 3]
    np.testing.assert_allclose(found, [0.4, beta, 0.7], atol=1e-7)
    back = Rotation.from_euler(sequence.upper(), found).as_matrix()
    np.testing.assert_allclose(back, R.as_matrix(), atol=1e-12)


@pytest.fixture(scope="module")
def loaded():
    """A driven chain with all its reactions, energies and wrenches sensed."""
    made = Mechanism(11, "chain", "mixed", n=3)
    model = made.model
    for name in model.joints:
        for quantity, on in itertools.product(("force", "moment"), "IJ"):
            for axes in ("joint", "global", "b1.f1"):
                model.add_sensor(
                    f"{name}_{quantity}_{on}_{axes.replace('.', '_')}", "reaction", joint=name,
                    quantity=quantity, on=on, axes=axes,
                )  # fmt: skip
    for name in model.drivers:
        model.add_sensor(f"of_{name}", "reaction", driver=name, quantity="moment")
    for quantity in ("kinetic", "strain", "gravity", "spring", "total"):
        model.add_sensor(quantity, "energy", quantity=quantity)
    for body, quantity in itertools.product(model.bodies, ("kinetic", "strain", "gravity")):
        model.add_sensor(f"{quantity}_{body}", "energy", quantity=quantity, body=body)
    model.add_sensor("pull", "reaction", force="spring0", axes="global")
    model.add_sensor("pushed", "reaction", force="spring0", axes="global", on="I")
    model.add_sensor("load", "reaction", force="torque_body1", quantity="moment")
    model.add_sensor("none", "reaction", force="torque_body1", axes="global")
    bench = Bench(model)
    bench.randomise(6)
    return bench.at()


def test_reaction_sensors_are_the_stored_reactions(loaded):
    found, stored = channels(loaded), loaded.reactions.reshape(-1, 12)
    R = loaded.marker("R")
    shown = loaded.sys.sensors.channels
    for k, owner in enumerate(loaded.layout.reactions):
        section, _, name = owner.partition(".")
        if section != "joints":
            continue
        row = loaded.sys.rows[loaded.sys.groups[k]["row"]]
        for at, (on, quantity) in enumerate(itertools.product("JI", ("force", "moment"))):
            own = stored[k, 3 * at : 3 * at + 3]
            there = R[row[on]] @ own
            column = loaded.layout.channels.index(f"{name}_{quantity}_{on}_b1_f1.x")
            axes = R[shown[column]["axes"]]
            for frame, wanted in (("joint", own), ("global", there), ("b1_f1", axes.T @ there)):
                values = [found[c] for c in vector(f"{name}_{quantity}_{on}_{frame}")]
                np.testing.assert_allclose(values, wanted, atol=1e-12 * np.abs(stored).max())


def test_energy_sensors_are_the_stored_energies(loaded):
    found, stored = channels(loaded), loaded.energies
    names = ("kinetic", "strain", "gravity", "spring")
    np.testing.assert_array_equal([found[name] for name in names], stored)
    assert found["total"] == pytest.approx(stored.sum(), rel=LAST_DIGITS)
    for name, whole in zip(names[:3], stored, strict=False):
        parts = [found[f"{name}_b{k}"] for k in range(3)]
        assert sum(parts) == pytest.approx(whole, rel=LAST_DIGITS)


def test_wrenches_of_springs_and_loads(loaded):
    found, spring = channels(loaded), loaded.sys.kinds["springs"].rows[0]
    x, vx = loaded.marker("x"), loaded.marker("vx")
    h, u = x[spring["J"]] - x[spring["I"]], vx[spring["J"]] - vx[spring["I"]]
    d = np.linalg.norm(h)
    pull = -(30.0 * (d - 0.5) + 2.0 * (h @ u) / d) * h / d
    np.testing.assert_allclose([found[c] for c in vector("pull")], pull, rtol=1e-12)
    np.testing.assert_allclose([found[c] for c in vector("pushed")], -pull, rtol=1e-12)
    t = loaded.state.t[0]
    wanted = [3 * np.cos(t), 2 + t, -1.0]
    np.testing.assert_allclose([found[c] for c in vector("load")], wanted, rtol=1e-12)
    np.testing.assert_array_equal([found[c] for c in vector("none")], 0.0)


def test_expressions_of_channels_in_the_units_of_the_scene():
    """A scene in mm and ms: the expression means mm and mm/ms, the channel is in SI."""
    model = Model("free body", units="mm-kg-ms", parameters={"r": 2})
    model.add_body("body", mass=1, inertia=[1, 1, 1], position=[30, 40, 0], velocity=[3, 0, 0])
    model.add_sensor("out", "expression", value="r*hypot(x.x, x.y) + v.x + t", unit="m")
    model.add_sensor("x", "position", of="body")
    model.add_sensor("v", "velocity", of="body")
    model.add_sensor("twice", "expression", value="2*out", unit="m")
    bench = Bench(model)
    bench.v[:3] = 3.0, 0.0, 0.0  # m/s, which is mm/ms
    bench.at(t=0.005)
    assert channels(bench)["out"] == pytest.approx(1e-3 * (2 * 50 + 3 + 5), rel=1e-12)
    assert channels(bench)["twice"] == pytest.approx(2e-3 * (2 * 50 + 3 + 5), rel=1e-12)


def test_the_axes_of_the_rotation_are_those_of_the_body(turning):
    """R of the bench and of these tests are the same rotation, body to global."""
    R = Rotation.random(random_state=8).as_matrix()
    turned(turning, R)
    np.testing.assert_allclose(rotation(turning.q[3:7]), R, atol=1e-14)
