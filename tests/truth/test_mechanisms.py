"""Published mechanisms with closed loops: Andrews' squeezer, the N-four-bar, Bricard's linkage.

Parameters and values with their sources are in references/mechanisms.json. Richardson's value of
two runs with steps h and h/2 leaves O(h³) or less; below some 1e-9 round-off in the accelerations,
u/(β'h²), takes over.
"""

from __future__ import annotations

import numpy as np
import pytest
from truthkit import extrapolated, order, reference, run

from flexmb.model import Model

# --- Andrews' squeezing mechanism: seven bodies, ten pins, one degree of freedom ---


def in_plane(*point):
    return [*map(float, point), 0.0]


def turned(angle, x, y):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * x - s * y, s * x + c * y])


def absolute(row):
    """Angles of the seven bodies from the coordinates of the test set."""
    beta, theta, gamma, phi, delta, omega, epsilon = row
    return np.array([beta, beta + theta, gamma, phi + delta, delta, omega + epsilon, epsilon])


def squeezer(p, angles, plane):
    made = Model("squeezing mechanism", plane=plane)
    fixed = {"O": (0, 0), "A": (p["xa"], p["ya"]), "B": (p["xb"], p["yb"]), "C": (p["xc"], p["yc"])}
    for name, at in fixed.items():
        made.add_marker(f"ground.{name}", position=in_plane(*at))
    A = np.array(fixed["A"])
    places = [
        fixed["O"], turned(angles[0], p["rr"], 0), fixed["B"],
        A + turned(angles[4], p["zt"], 0), A, A + turned(angles[6], 0, -p["u"]), A,
    ]  # fmt: skip
    centers = [
        (p["ra"], 0), (-p["da"], 0), (p["sb"], -p["sa"]), (0, p["ea"] - p["e"]),
        (p["ta"], p["tb"]), (p["zf"] - p["fa"], 0), (-p["ub"], -p["ua"]),
    ]  # fmt: skip
    ends = [
        (p["rr"], 0), (-p["d"], 0), (0, -p["ss"]), (0, -p["e"]), (p["zt"], 0), (p["zf"], 0),
        (0, -p["u"]),
    ]  # fmt: skip
    for k in range(7):
        made.add_body(
            f"K{k + 1}", mass=p[f"m{k + 1}"], center=in_plane(*centers[k]),
            inertia=[p[f"i{k + 1}"]] * 3, position=in_plane(*places[k]),
            orientation={"axis": "z", "angle": float(angles[k])},
            markers={"end": {"position": in_plane(*ends[k])}},
        )  # fmt: skip
        made.add_sensor(f"K{k + 1}", "angle", between=["ground", f"K{k + 1}"], axis="z")
    pins = {
        "O": ("ground.O", "K1"), "P": ("K1.end", "K2"), "B": ("ground.B", "K3"),
        "A5": ("ground.A", "K5"), "Q": ("K5.end", "K4"), "A7": ("ground.A", "K7"),
        "S": ("K7.end", "K6"),
        "E3": ("K2.end", "K3.end"), "E4": ("K2.end", "K4.end"), "E6": ("K2.end", "K6.end"),
    }  # fmt: skip
    for name, ends in pins.items():
        made.add_joint(name, "revolute", between=list(ends), axis="z")
    made.add_marker("K3.D", position=in_plane(p["sd"], -p["sc"]))
    made.add_force(
        "spring", "spring-damper", between=["ground.C", "K3.D"], stiffness=p["c0"],
        free_length=p["l0"],
    )  # fmt: skip
    made.add_force("drive", "torque", at="K1", value=[0, 0, p["mom"]])
    return made


@pytest.fixture(scope="module", params=["xy", None])
def squeezed(request):
    """Table of the reference, the angles at the start, runs with h and h/2."""
    table = reference("mechanisms", "andrews")
    start = absolute(table["initial_q"])
    made = squeezer(table["params"], start, request.param)
    runs = [
        run(made, duration=0.03, step=h, outputs=3, newton_tolerance=1e-11) for h in (8e-6, 4e-6)
    ]
    return table, start, runs


def test_andrews_squeezer_moves_as_computed_to_20_digits(squeezed):
    """15 rad in 0.03 s; closed by an angle that turns two and a half times."""
    table, start, runs = squeezed
    truth = table["computed_t003"]
    angles = extrapolated(*[one.sensors[-1, :7] for one in runs]) + start
    wanted = absolute(truth["q"])
    angles += 2 * np.pi * np.rint((wanted - angles) / (2 * np.pi))
    np.testing.assert_allclose(angles, wanted, rtol=0, atol=1e-7)
    speeds = extrapolated(*[one.v[-1, 5::6] for one in runs])
    wanted = absolute(truth["v"])
    np.testing.assert_allclose(speeds, wanted, rtol=0, atol=1e-7 * np.abs(wanted).max())
    accelerations = extrapolated(*[one.vd[-1, 5::6] for one in runs])
    wanted = absolute(truth["a"])
    np.testing.assert_allclose(accelerations, wanted, rtol=0, atol=5e-7 * np.abs(wanted).max())
    for t, row in table["computed_other_times"].items():
        at = runs[0].at([float(t)])[0]
        speeds = extrapolated(*[one.v[at, 5::6] for one in runs])
        wanted = absolute(row["v"])
        np.testing.assert_allclose(speeds, wanted, rtol=0, atol=1e-7 * np.abs(wanted).max())


def test_andrews_squeezer_has_the_published_multipliers(squeezed):
    """Its three loops close K2 with K3, K4 and K6: λ is the force of K2 on them.

    The axes of each joint are global at the start and turn with its marker J.
    """
    table, _, runs = squeezed

    def forces(one, row):
        found = []
        for name, body in (("E3", "K3"), ("E4", "K4"), ("E6", "K6")):
            at = 12 * one.layout.reactions.index(f"joints.{name}")
            found.extend(turned(one[body][row], *one.reactions[row, at : at + 2]))
        return np.array(found)

    wanted = np.array(table["computed_t003"]["lam_Mw_plus_GTlam"])
    found = extrapolated(*[forces(one, -1) for one in runs])
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-6 * np.abs(wanted).max())
    # The spring alone, as published (reported reactions carry O(h²) of stiff modes).
    at_rest = [98.56687039624109, -6.122688344255663, 0, 0, 0, 0]
    found = extrapolated(*[forces(one, 0) for one in runs])
    np.testing.assert_allclose(found, at_rest, rtol=0, atol=1e-10 * 98.6)


# --- IFToMM A02: N parallelograms, which leave their branch where they lie flat ---


def four_bars(n, plane="xy"):
    made = Model("N-four-bar", gravity=[0, -9.81, 0], plane=plane)
    J = 1 / 12  # slender rods, 1 kg and 1 m
    for k in range(n + 1):
        made.add_body(
            f"crank{k}", mass=1, center=[0, 0.5, 0], inertia=[J, 1e-3, J], position=[k, 0, 0],
            angular_velocity=[0, 0, -1.0], velocity=[0, 0, 0],
        )  # fmt: skip
        made.add_marker(f"crank{k}.end", position=[0, 1, 0])
        made.add_marker(f"ground.pivot{k}", position=[k, 0, 0])
        made.add_joint(f"pivot{k}", "revolute", between=[f"ground.pivot{k}", f"crank{k}"], axis="z")
    for k in range(1, n + 1):
        made.add_body(
            f"rod{k}", mass=1, center=[0.5, 0, 0], inertia=[1e-3, J, J], position=[k - 1, 1, 0],
            velocity=[1, 0, 0],
        )  # fmt: skip
        made.add_marker(f"rod{k}.end", position=[1, 0, 0])
        ends = [f"crank{k - 1}.end", f"rod{k}"], [f"rod{k}.end", f"crank{k}.end"]
        for side, between in zip(("left", "right"), ends, strict=True):
            made.add_joint(f"{side}{k}", "revolute", between=between, axis="z")
    made.add_sensor("place", "position", of="crank0.end")
    made.add_sensor("speed", "velocity", of="crank0.end")
    return made


def crank_end(result, rows):
    return np.hstack([result.vector("place")[rows, :2], result.vector("speed")[rows, :2]])


@pytest.mark.parametrize("plane", ["xy", None])
def test_iftomm_four_bars_stay_on_their_branch(plane):
    """Ten turns through twenty flat positions, where the constraints lose rank.

    A mechanism that took the other branch once would be off by metres. In space six rows of 35 are
    redundant: 30 coordinates, one freedom.
    """
    table = reference("mechanisms", "iftomm_A02_N_four_bar_N2")["values"]
    wanted = np.array([[row[c] for c in ("B0x", "B0y", "B0vx", "B0vy")] for row in table.values()])
    steps = np.array([1e-3, 5e-4])
    made = four_bars(2, plane)
    runs = [run(made, duration=10.0, step=h, outputs=1000, newton_tolerance=1e-11) for h in steps]
    ends = [crank_end(one, one.at([float(t) for t in table])) for one in runs]
    errors = [np.abs(end - wanted).max() for end in ends]
    assert 1.8 < order(steps, errors) < 2.2, errors
    assert errors[-1] < 2e-4
    np.testing.assert_allclose(extrapolated(*ends), wanted, rtol=0, atol=1e-5)


@pytest.mark.parametrize("n", [1, 5, 10, 20, 40])
def test_iftomm_many_four_bars(n):
    """One second, half a turn: O(h²) of it, some (7 rad/s h)² of 7 m/s.

    In the flat position the constraints lose rank, and with many loops Newton's method was seen to
    find the accelerations to 1e-6 of them but not always to the usual 1e-8.
    """
    table = reference("mechanisms", "iftomm_A02_N_four_bar_other_N")["values"][str(n)]["1"]
    result = run(four_bars(n), duration=1.0, step=1e-3, outputs=10, newton_tolerance=1e-6)
    wanted = [table[c] for c in ("B0x", "B0y", "B0vx", "B0vy")]
    np.testing.assert_allclose(crank_end(result, [-1])[0], wanted, rtol=0, atol=2e-4)


# --- IFToMM A04: a loop of six hinges in space that moves in spite of its count ---

_HINGES = "yzxyzx"


def bricard(params):
    made = Model("Bricard", gravity=params["g"])
    points = np.array(params["points"])
    for k, along in enumerate(np.diff(points, axis=0)):
        inertia = np.where(np.abs(along) > 0.5, 0.02, 1.01) / 12  # 1 kg, 1 m, 0.1 m square
        made.add_body(
            f"bar{k}", mass=1, center=list(along / 2), inertia=list(inertia),
            position=list(points[k]),
        )  # fmt: skip
        made.add_marker(f"bar{k}.end", position=list(along))
    made.add_marker("ground.end", position=list(points[5]))
    ends = ["ground", *(f"bar{k}.end" for k in range(5))], [*(f"bar{k}" for k in range(5))]
    for k, between in enumerate(zip(ends[0], [*ends[1], "ground.end"], strict=True)):
        made.add_joint(f"hinge{k}", "revolute", between=list(between), axis=_HINGES[k])
    for k in range(1, 5):
        made.add_sensor(f"P{k}", "position", of=f"bar{k}")
    return made


def bricard_truth():
    """Times and (n, 12) points P1 to P4."""
    table = reference("mechanisms", "iftomm_A04_bricard")["values"]
    rows = [np.hstack([row["points"][f"P{k}"] for k in range(1, 5)]) for row in table.values()]
    return [float(t) for t in table], np.array(rows)


def test_iftomm_bricard():
    """30 coordinates, 30 rows of which one is redundant: ten seconds to 3e-8 of a metre."""
    times, wanted = bricard_truth()
    made = bricard(reference("mechanisms", "iftomm_A04_bricard")["params"])
    steps = np.array([4e-3, 2e-3])
    runs = [run(made, duration=10.0, step=h, outputs=20, newton_tolerance=1e-11) for h in steps]
    points = [one.sensors[one.at(times)] for one in runs]
    errors = [np.abs(found - wanted).max() for found in points]
    assert 1.9 < order(steps, errors) < 2.1, errors
    np.testing.assert_allclose(extrapolated(*points), wanted, rtol=0, atol=3e-8)


BRICARD = {"duration": 10.0, "outputs": 100}


@pytest.fixture(scope="module")
def exact_bricard():
    """A run that is on all points of the table to 1e-12 m."""
    times, wanted = bricard_truth()
    made = bricard(reference("mechanisms", "iftomm_A04_bricard")["params"])
    found = run(made, accuracy=1e-12, method="explicit-rk", verify=False, **BRICARD)
    np.testing.assert_allclose(found.sensors[found.at(times)], wanted, rtol=0, atol=1e-12)
    return made, found.sensors


@pytest.mark.seconds
@pytest.mark.parametrize(
    "knobs",
    [{}, {"method": "explicit-rk", "order": 5}, {"method": "radau"}],
    ids=["auto", "order 5", "radau"],
)
@pytest.mark.parametrize("accuracy", [1e-3, 1e-5, 1e-7])
def test_iftomm_bricard_to_the_accuracy_asked_for(exact_bricard, knobs, accuracy):
    made, wanted = exact_bricard
    found = run(made, accuracy=accuracy, **BRICARD, **knobs)
    names = [channel.rpartition(".")[0] for channel in found.layout.channels]
    spans = {name: np.ptp(wanted, axis=0)[[n == name for n in names]].max() for name in names}
    error = (np.abs(found.sensors - wanted).max(axis=0) / [spans[name] for name in names]).max()
    assert error < 2 * accuracy
    said = found.statistics["measured_error_of_positions"]
    assert error < max(3 * said, (0.2 if accuracy < 1e-5 or not knobs else 0.8) * accuracy)


@pytest.mark.parametrize("method", ["radau", "explicit-rk"])
def test_reactions_of_least_norm_between_steps(method):
    """One of 30 equations is redundant in poses that close alone: Bricard's, not near it.

    By the textbook's method, which solves the pose of each output, reactions are the same.
    """
    made = bricard(reference("mechanisms", "iftomm_A04_bricard")["params"])
    knobs = {"duration": 1.0, "outputs": 37}
    near = run(made, method="coordinate-partitioning", accuracy=1e-9, verify=False, **knobs)
    found = run(made, method=method, accuracy=1e-3, verify=False, **knobs)
    wanted = near.lam
    assert np.abs(found.lam - wanted).max() < 2e-3 * np.abs(wanted).max()
