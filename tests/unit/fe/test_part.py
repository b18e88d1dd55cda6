"""A part by itself: closed forms, symmetry, balance, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from flexmb.errors import FlexmbError, FlexmbWarning
from flexmb.fe import Mesh, mesh_from, part
from flexmb.flexbody import load_part, save_part

STEEL = {"E": 200e9, "nu": 0.3, "density": 8000}
BEAM = {"type": "beam", "length": 2.0, "divisions": 12}
SECTION = {"all": {"type": "rectangle", "y": 0.02, "z": 0.03, "shear": False}}
EI = 200e9 * 0.03 * 0.02**3 / 12  # about the weak axis
CLAMPED = {"group": "start", "type": "clamped"}


WEIGHT = {"q": {"type": "gravity", "acceleration": [0, 50.0 / (8000 * 6e-4), 0]}}  # 50 N/m


def beam(**words):
    return part(BEAM, material=STEEL, sections=SECTION, **words)


def at_end(force, group="end"):
    return {"push": {"type": "force", "group": group, "force": force}}


ENDS = {  # supports, factor in P L^2/EI (Timoshenko, Gere: Theory of Elastic Stability), beta L
    "clamped, free": ({"a": CLAMPED}, np.pi**2 / 4, 1.8751040687),
    "pinned": (
        {"a": {"group": "start", "hold": ["ux", "uy", "uz", "rx"]},
         "b": {"group": "end", "hold": ["uy", "uz"]}}, np.pi**2, np.pi,
    ),
    "clamped, pinned": (
        {"a": CLAMPED, "b": {"group": "end", "hold": ["uy", "uz"]}}, 20.19072856, 3.9266023120,
    ),
    "clamped": (
        {"a": CLAMPED, "b": {"group": "end", "hold": ["uy", "uz", "rx", "ry", "rz"]}},
        4 * np.pi**2, 4.7300407449,
    ),
}  # fmt: skip


@pytest.mark.parametrize("ends", ENDS)
def test_a_column_buckles_and_vibrates_as_its_ends_say(ends):
    supports, factor, root = ENDS[ends]
    load = at_end([-1000.0, 0, 0])
    found = beam(supports=supports, loads=load, buckling=1, frequencies=1)
    assert found.load_factors[0] * 1000 * 4 / EI == pytest.approx(factor, rel=1e-3)
    expected = root**2 * np.sqrt(EI / (8000 * 6e-4 * 2**4)) / (2 * np.pi)
    assert found.frequencies[0] == pytest.approx(expected, rel=1e-3)
    assert found.imbalance < 1e-12
    half = {"push": {**load["push"], "force": [-500 * found.load_factors[0], 0, 0]}}
    loaded = beam(supports=supports, loads=half, frequencies=1, preload=True)
    # pinned ends keep their shape under the force: f^2 falls linearly to 0 at the factor
    share = (loaded.frequencies[0] / found.frequencies[0]) ** 2
    assert share == pytest.approx(0.5, abs=1e-6 if ends == "pinned" else 0.03)
    too_much = {"push": {**load["push"], "force": [-1001 * found.load_factors[0], 0, 0]}}
    with pytest.raises(FlexmbError, match="not stable under its loads"):
        beam(supports=supports, loads=too_much, frequencies=1, preload=True)


def test_an_imposed_displacement_bends_a_beam_and_an_oblique_support_slides():
    held = {"a": CLAMPED, "b": {"group": "end", "hold": ["uy"], "displacement": [0, 1e-3, 0]}}
    found = beam(supports=held)
    assert found.reactions["b"].force[1] == pytest.approx(3 * EI * 1e-3 / 8, rel=1e-9)
    assert found.reactions["a"].moment[2] == pytest.approx(-3 * EI * 1e-3 / 4, rel=1e-9)
    assert found.quantity("displacement.end.y") == pytest.approx(1e-3, rel=1e-12)
    slope = np.array([0.6, 0.8, 0.0])
    held = {"a": CLAMPED, "b": {"group": "end", "type": "sliding", "normal": slope}}
    found = beam(supports=held, loads=at_end([100.0, 200.0, 30.0]))
    moved = found.displacements()[-1]
    assert abs(moved @ slope) < 1e-15 < np.abs(moved).max()
    across = np.cross(found.reactions["b"].force, slope)
    assert np.abs(across).max() < 1e-9
    assert found.imbalance < 1e-12


def test_an_imposed_turn_of_a_face_carries_the_whole_part_along():
    """u = turn x (x - c) everywhere, c the centroid of the face that is turned."""
    turn = np.array([1e-4, -2e-4, 3e-4])
    found = part(
        {"type": "box", "size": [1.0, 0.4, 0.2], "divisions": [2, 1, 1]}, material=STEEL,
        supports={"a": {"group": "x0", "hold": ["ux", "uy", "uz"], "rotation": list(turn)}},
    )  # fmt: skip
    assert found.imbalance == 0.0
    points = found.nodes.position
    wanted = np.cross(turn, points - [0.0, points[:, 1].mean(), points[:, 2].mean()])
    np.testing.assert_allclose(found.displacements(), wanted, atol=1e-9)


def test_half_a_beam_with_a_plane_of_symmetry_is_the_whole():
    supports = {"a": {"group": "start", "hold": ["ux", "uy", "uz", "rx"]}}
    whole = part(
        {"type": "beam", "length": 4.0, "divisions": 24}, material=STEEL, sections=SECTION,
        supports={**supports, "b": {"group": "end", "hold": ["uy", "uz"]}},
        loads=WEIGHT, frequencies=6,
    )  # fmt: skip
    plane = {"group": "end", "type": "symmetric", "normal": "x"}
    free_axial = {"a": {"group": "start", "hold": ["uy", "uz", "rx"]}, "middle": plane}
    half = beam(supports=free_axial, loads=WEIGHT, frequencies=2)
    exact = 5 * 50.0 * 4.0**4 / (384 * EI)
    assert half.quantity("displacement.end.y") == pytest.approx(exact, rel=1e-9)
    np.testing.assert_allclose(half.frequencies, whole.frequencies[[0, 1]], rtol=1e-9)
    odd = {"a": free_axial["a"], "middle": {**plane, "type": "antisymmetric"},
           "axial": {"group": "start", "hold": ["ux"]}}  # fmt: skip
    other = beam(supports=odd, frequencies=2)
    np.testing.assert_allclose(other.frequencies, whole.frequencies[[2, 3]], rtol=1e-9)
    forces = half.section_forces.at(half.column())
    assert abs(forces[-1, 1, 5]) == pytest.approx(50.0 * 4**2 / 8, rel=2e-3)


@pytest.mark.parametrize("kind", ["rbe2", "rbe3"])
@pytest.mark.parametrize("scale, units", [(1.0, "SI"), (1e3, "mm-t-s")])
def test_interfaces_are_hinged_and_loaded_at_their_points(kind, scale, units):
    size = [1.0 * scale, 0.1 * scale, 0.05 * scale]
    found = part(
        {"type": "box", "size": size, "divisions": [8, 1, 1]}, units=units, material=STEEL,
        interfaces={"root": {"group": "x0", "type": kind}, "tip": {"group": "x1", "type": kind}},
        supports={"root": {"interface": "root", "type": "hinged", "axis": "z"},
                  "tip": {"interface": "tip", "hold": ["uy"]}},
        loads={"turn": {"type": "interface", "interface": "root", "moment": [0, 0, 120.0]}},
    )  # fmt: skip
    np.testing.assert_allclose(found.reactions["tip"].force, [0, -120, 0], rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(found.reactions["root"].force, [0, 120, 0], rtol=1e-9, atol=1e-6)
    assert np.abs(found.reactions["root"].moment).max() < 1e-6
    assert found.imbalance < 1e-9
    slope = 120.0 * 1.0 / (3 * 200e9 * 0.05 * 0.1**3 / 12)  # M L/(3 E I)
    assert found.quantity("rotation.root.z") == pytest.approx(slope, rel=0.06)


def test_a_thick_cylinder_under_pressure_follows_lame():
    a, b, p, nu = 0.05, 0.1, 1e8, 0.3
    tube = {"type": "tube", "length": 0.05, "radius": b, "inner": a, "divisions": [3, 24, 1]}
    mesh = mesh_from(tube)
    bore = [n for n in mesh.node_sets["inner"] if mesh.points[n, 0] < 1e-9]
    y, z = ([int(n) for n in bore if abs(mesh.points[n, c]) < 1e-9] for c in (1, 2))
    found = part(
        tube, material=STEEL,
        supports={"start": {"group": "start", "type": "symmetric"},
                  "end": {"group": "end", "type": "sliding"},
                  "z": {"nodes": z, "hold": ["uz"]},
                  "y": {"nodes": y, "hold": ["uy"]}},
        loads={"p": {"type": "pressure", "group": "inner", "pressure": p}},
    )  # fmt: skip
    ratio = a**2 / (b**2 - a**2)
    grown = (1 + nu) / 200e9 * p * ratio * ((1 - 2 * nu) * a + b**2 / a)
    assert found.quantity(f"displacement.{z[0]}.y") == pytest.approx(grown, rel=5e-4)
    hoop, radial = p * ratio * (1 + b**2 / a**2), -p
    assert found.quantity(f"principal.{z[0]}.1") == pytest.approx(hoop, rel=0.02)
    assert found.quantity(f"principal.{z[0]}.3") == pytest.approx(radial, rel=0.03)
    assert found.reactions["end"].force[0] == pytest.approx(
        2 * nu * p * ratio * np.pi * (b**2 - a**2), rel=5e-3
    )


def test_a_spinning_beam_is_stretched_and_stiffened():
    h, n = 0.002, 12
    rate = np.sqrt(200e9 * h * h / 12 / 8000) / 4  # sqrt(EI/(rho A L^4))
    speed = 12 * rate
    found = part(
        {**BEAM, "divisions": n}, material=STEEL,
        sections={"all": {"type": "rectangle", "y": h, "z": h, "shear": False}},
        supports={"a": CLAMPED}, frequencies=2, preload=True,
        loads={"turn": {"type": "spin", "angular_velocity": [0, 0, speed]}},
    )  # fmt: skip
    pull = 8000 * h * h * speed**2 * 2**2 / 2
    assert found.reactions["a"].force[0] == pytest.approx(-pull, rel=1e-10)
    stretch = 8000 * speed**2 * 2**3 / 3 / 200e9
    assert found.quantity("displacement.end.x") == pytest.approx(stretch, rel=3e-3)
    # tests/references: rotating_beam_EB_flap at speed 12; lag^2 = flap^2 - speed^2
    np.testing.assert_allclose(found.frequencies * 2 * np.pi / rate, [5.4271, 13.1702], rtol=2e-4)


def test_a_result_is_stored_and_read(tmp_path):
    found = beam(supports={"a": CLAMPED}, loads=at_end([0, 0, 5.0]), frequencies=2, buckling=0)
    again = load_part(save_part(found, tmp_path / "beam.part.h5"))
    assert again.fields == ("static", "mode 1", "mode 2")
    for name in ("frequency.2", "reaction.a.My", "von_mises", "section_force.0.1.My"):
        assert again.quantity(name) == found.quantity(name) != 0.0
    with pytest.raises(FlexmbError, match="nearest: reaction"):
        found.quantity("reacton.a.Fz")
    with pytest.raises(FlexmbError, match='no support "b"'):
        found.quantity("reaction.b.Fz")


def test_supports_that_leave_a_motion_name_it():
    load = at_end([0, 0, 1.0])
    with pytest.raises(FlexmbError, match="translation along y; hold it"):
        beam(supports={"a": {"group": "start", "hold": ["ux", "uz", "rx", "ry", "rz"]}}, loads=load)
    with pytest.raises(FlexmbError, match=r"rotation about x through \(1, 0, 0\) m; hold it"):
        supports = {
            "a": {"group": "start", "type": "hinged"},
            "b": {"group": "end", "hold": ["uy", "uz"]},
        }
        beam(supports=supports, loads=load)
    free = beam(frequencies=2)
    assert "translation along x" in free.notes[0]
    expected = 4.730040744862704**2 * np.sqrt(EI / (8000 * 6e-4 * 2**4)) / (2 * np.pi)
    assert free.frequencies[0] == pytest.approx(expected, rel=1e-3)


def test_all_mistakes_are_told_at_once():
    with pytest.raises(FlexmbError) as caught:
        part(
            BEAM, sections=SECTION, interfaces={"tip": "end"},
            supports={"a": {"group": "strat", "hold": ["ux", "uq"]},
                      "b": {"group": "start", "type": "clampd"},
                      "c": {"interface": "tpi", "type": "clamped"}},
            loads={"p": {"type": "forse", "group": "end"},
                   "q": {"type": "line", "group": "edn", "force": [0, 0, 1]}},
        )  # fmt: skip
    text = str(caught.value)
    for piece in ("material", 'unknown "uq"', "nearest: clamped", "nearest: start", "nearest: tip",
                  "nearest: force", "nearest: end"):  # fmt: skip
        assert piece in text


@pytest.mark.parametrize(
    "words, sentence",
    [
        ({"supports": {"a": CLAMPED}}, "nothing to compute"),
        ({"supports": {"a": CLAMPED}, "buckling": 1, "frequencies": 1}, "there are none"),
        ({"supports": {"a": {**CLAMPED, "hold": ["ux"]}}, "frequencies": 1}, "given both"),
        ({"supports": {"a": CLAMPED}, "loads": at_end([1.0, 0, 0], "start")}, "straight into a"),
        (
            {"supports": {"a": {"group": "start", "type": "symmetric"}}, "frequencies": 1},
            "lie on a line or a point",
        ),
        (
            {"supports": {"a": {"group": "start", "hold": ["ux"], "displacement": [0, 1, 0]}}},
            "moves along y, which the support leaves free",
        ),
        (
            {"supports": {"a": CLAMPED, "b": {**CLAMPED, "displacement": [1e-3, 0, 0]}}},
            'moves node 0 by 0.001, the support "a" by 0',
        ),
        (
            {"supports": {"a": CLAMPED}, "interfaces": {"root": "start"}, "frequencies": 1},
            'move rigidly with the interface "root"',
        ),
        ({"supports": {"a": CLAMPED}, "frequencies": 1000}, "degrees of freedom"),
        ({"supports": {"a": CLAMPED}, "frequencies": {"band": [5.0, 1.0]}}, "the lower one first"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused(words, sentence):
    with pytest.raises(FlexmbError, match=sentence):
        beam(**words)


def test_transverse_forces_of_a_plate_carry_the_load():
    """A strip along y under a line load at its end: Q = q along it, in axes turned too."""
    for angle in (0.0, 0.5):
        towards = [np.cos(angle), np.sin(angle), 0.0]
        found = part(
            {"type": "plate", "length": 0.2, "width": 1.0, "divisions": [2, 10]},
            material={**STEEL, "nu": 0.0},
            sections={"all": {"type": "shell", "thickness": 0.01, "orientation": towards}},
            supports={"a": {"group": "y0", "type": "clamped"}},
            loads={"q": {"type": "line", "group": "y1", "force": [0, 0, -100.0]}},
        )  # fmt: skip
        forces = found.shell_forces.at(found.column())[:, 6:]
        rows = np.searchsorted(found.nodes.ids, found.shell_forces.ids)
        inside = np.abs(found.nodes.position[rows, 1] - 0.5) < 0.3
        wanted = 100.0 * np.array([np.sin(angle), np.cos(angle)])
        size = np.sign(forces[inside][0] @ wanted)
        np.testing.assert_allclose(
            forces[inside], np.tile(size * wanted, (inside.sum(), 1)), atol=1
        )


def test_a_part_that_turns_ever_faster_is_held_by_its_support():
    """Force m a and moment of ∫ρ s × a of a bar along x, a = α × (s − p) + ω × (ω × (s − p))."""
    p, w, alpha = np.array([0.3, -0.2, 0.5]), np.array([1.0, 2.0, 3.0]), np.array([40, 50, -60])
    found = beam(
        supports={"a": CLAMPED},
        loads={"turn": {"type": "spin", "angular_velocity": w.tolist(),
                        "angular_acceleration": alpha.tolist(), "position": p.tolist()}},
    )  # fmt: skip
    at, weights = np.polynomial.legendre.leggauss(3)
    arms = np.outer(1.0 + at, [1.0, 0, 0])
    a = np.cross(alpha, arms - p) + np.cross(w, np.cross(w, arms - p))
    forces = 8000 * 6e-4 * weights[:, None] * a
    np.testing.assert_allclose(found.reactions["a"].force, forces.sum(axis=0), rtol=1e-9)
    moment = np.cross(arms, forces).sum(axis=0)[1:]  # that about x is of the section too
    np.testing.assert_allclose(found.reactions["a"].moment[1:], moment, rtol=1e-3)


@pytest.mark.parametrize(
    ("load", "factor"),
    [
        ({"type": "gravity", "acceleration": [-1.0, 0, 0]}, 7.837),
        ({"type": "spin", "angular_velocity": [0, 0, 1.0], "position": [2.0, 0, 0]}, 16.1),
    ],
    ids=["gravity", "spin"],
)
def test_a_column_buckles_under_loads_along_it(load, factor):
    """∫q dx = 7.837 EI/L² of its weight, 16.1 of loads that fall to zero at the free end, as of a
    bar that turns about that end (Timoshenko and Gere, §2.12)."""
    found = part(
        {**BEAM, "divisions": 3}, material=STEEL, sections=SECTION, supports={"a": CLAMPED},
        loads={"q": load}, buckling=1,
    )  # fmt: skip
    assert found.load_factors[0] * 8000 * 6e-4 * 2**3 / EI == pytest.approx(factor, rel=0.01)


def test_a_band_holds_the_modes_between_its_frequencies():
    lowest = beam(supports={"a": CLAMPED}, frequencies=6).frequencies
    low, high = 0.5 * (lowest[1] + lowest[2]), 0.5 * (lowest[4] + lowest[5])
    found = beam(supports={"a": CLAMPED}, frequencies={"band": [low, high]})
    np.testing.assert_allclose(found.frequencies, lowest[2:5], rtol=1e-9)


def test_a_hinge_of_solid_nodes_that_cannot_turn_is_named():
    """An edge turns about itself: P l/(3 EI) on simple supports; a face held node by node not."""
    solid = {"type": "box", "size": [1.0, 0.1, 0.05], "divisions": [6, 1, 2]}
    push = {"push": {"type": "force", "group": "x1", "force": [0.0, 0.0, 1.0]}}
    words = {"material": STEEL, "loads": push}
    edge = np.flatnonzero((mesh_from(solid).points[:, ::2] == [0.0, 0.0]).all(axis=1)).tolist()
    turning = {"a": {"nodes": edge, "type": "hinged", "axis": "y"}}
    with pytest.raises(FlexmbError, match="rotation about y"):
        part(solid, supports=turning, **words)
    for axis, support in (("y", {"group": "x0"}), ("z", {"nodes": edge})):
        stiff = {
            "a": {**support, "type": "hinged", "axis": axis},
            "b": {"group": "x1", "hold": ["ux", "uy"]},
        }
        with pytest.warns(
            FlexmbWarning, match="supports.a: its nodes belong to solids and do not lie"
        ):
            part(solid, supports=stiff, **words)


def test_quantities_that_mean_two_things_or_none_are_refused():
    plate = part(
        {"type": "plate", "length": 1.0, "width": 0.5, "divisions": [4, 2]},
        material=STEEL,
        sections={"all": {"type": "shell", "thickness": 0.01, "orientation": "-x"}},
        supports={"a": {"group": "x0", "type": "clamped"}},
        loads={"push": {"type": "line", "group": "x1", "force": [0.0, 0.0, 10.0]}},
    )
    assert plate.quantity("stress.4.top.xx") == -plate.quantity("stress.4.bottom.xx") != 0.0
    for name, sentence in (
        (
            "stress.4.xx",
            r"has 2 stresses at node 4 \(bottom.all, top.all\); name a layer, a section",
        ),
        ("stress.4.topp.xx", 'no stress in a layer or section "topp"; nearest: top'),
        ("principal.4.top.0", "is not of the form principal.17.1"),
        ("displacement.x1.w", r"is not of the form displacement.tip.z: interface, group or node$"),
    ):
        with pytest.raises(FlexmbError, match=sentence):
            plate.quantity(name)


def test_stress_where_the_thickness_changes_is_that_of_a_section():
    """M/(w h^2/6) at the step of a strip that is bent by a couple, on both sides of it."""
    points = [(x, y, 0.0) for x in (0.0, 0.5, 1.0) for y in (0.0, 0.2)]
    quads = np.array([[0, 2, 3, 1], [2, 4, 5, 3]])
    groups = {"thick": {"quad": np.array([0])}, "thin.2": {"quad": np.array([1])}}
    strip = part(
        Mesh(np.array(points), {"quad": quads}, {}, groups),
        material={"E": 210e9, "nu": 0.0, "density": 7850.0},
        sections={
            "thick": {"type": "shell", "thickness": 0.02},
            "thin.2": {"type": "shell", "thickness": 0.01},
        },
        interfaces={"end": {"nodes": [4, 5]}},
        supports={"wall": {"nodes": [0, 1], "type": "clamped"}},
        loads={"couple": {"type": "interface", "interface": "end", "moment": [0.0, 3.0, 0.0]}},
    )
    for section, h in (("thick", 0.02), ("thin.2", 0.01)):
        expected = 3.0 / (0.2 * h**2 / 6)
        assert strip.quantity(f"stress.3.top.{section}.xx") == pytest.approx(expected, rel=1e-6)
        assert strip.quantity(f"von_mises.3.{section}") == pytest.approx(expected, rel=1e-6)
    with pytest.raises(FlexmbError, match=r"node 3 \(top.thick, top.thin.2\); name a layer, a sec"):
        strip.quantity("stress.3.top.xx")


def test_a_ring_buckles_under_a_pressure_that_keeps_its_direction():
    """p R^3/(E I) = 4 with the ring held from turning (Bodner 1958: 3 if the pressure turns)."""
    n, width, h = 32, 0.05, 0.01
    angle = np.repeat(2 * np.pi / n * np.arange(n), 2)
    points = np.stack([np.cos(angle), np.sin(angle), np.tile([0.0, width], n)], axis=1)
    quads = (2 * np.arange(n)[:, None] + [0, 2, 3, 1]) % (2 * n)
    held = {f"{c}{k}": {"node": 2 * k, "hold": [c]} for k, c in ((0, "uy"), (n // 2, "uy"))}
    held |= {
        f"{c}{k}": {"node": 2 * k, "hold": [c]} for k, c in ((n // 4, "ux"), (3 * n // 4, "ux"))
    }
    held["z"] = {"nodes": [0, n // 2, n], "hold": ["uz"]}
    ring = part(
        Mesh(points, {"quad": quads}, {}, {"skin": {"quad": np.arange(n)}}),
        material={"E": 210e9, "nu": 0.0, "density": 7800.0},
        sections={"skin": {"type": "shell", "thickness": h}},
        supports=held,
        loads={"water": {"type": "pressure", "group": "skin", "pressure": -1.0}},
        buckling=1,
    )
    assert ring.load_factors[0] == pytest.approx(4 * 210e9 * h**3 / 12, rel=0.02)
    assert ring.imbalance == 0.0  # it pushes evenly, so nothing acts at the supports
    assert "pressures keep their direction" in ring.notes[0]


def test_a_free_part_with_a_hinge_is_refused_without_talk_of_supports():
    """A plate that shares a line of nodes with a solid swings about it."""
    box = mesh_from(
        {"type": "box", "size": [1, 0.2, 0.2], "divisions": [2, 1, 2], "elements": "hexahedron"}
    )
    line = np.flatnonzero((box.points[:, ::2] == [1.0, 0.0]).all(axis=1))
    n = len(box.points)
    points = np.vstack([box.points, box.points[line] + [0.5, 0.0, 0.0]])
    cells = box.blocks | {"quad": np.array([[line[0], n, n + 1, line[1]]])}
    hinged = Mesh(points, cells, {}, {"skin": {"quad": np.array([0])}})
    skin = {"skin": {"type": "shell", "thickness": 0.01}}
    with pytest.raises(
        FlexmbError, match="^the free body has a hinge: .* solids, which have no rot"
    ):
        part(hinged, material=STEEL, sections=skin, frequencies=2)


def test_a_post_on_a_spring_buckles_at_its_stiffness_over_the_length():
    """P = k/L; a spring that sinks by 0.2 m first has axes that turn: a wrong factor is noted."""
    points = np.array([[0.0, 0, 0], [0, 0, 0], [0, 0, 0.5], [0, 0, 1.0], [0, 1, 0], [1, 1, 0]])
    post = Mesh(points, {"line": np.array([[1, 2], [2, 3], [0, 4], [4, 5]])})
    for along, about, notes in ((1e10, 1e4, 0), (1e5, 1e8, 1)):
        stiffness = [1e10, 1e10, along, about, about, 1e8]
        found = part(
            post, material=STEEL,
            sections={"all": {"type": "circle", "radius": 0.1, "shear": False}},
            springs={"mount": {"between": [0, 1], "stiffness": stiffness}},
            supports={"ground": {"nodes": [0, 4, 5], "type": "clamped"}},
            loads={"P": {"type": "force", "node": 3, "force": [0.0, 0.0, -1.0]}}, buckling=1,
        )  # fmt: skip
        assert len(found.notes) == notes and all('spring "mount" yields' in n for n in found.notes)
        if not notes:
            assert found.load_factors[0] == pytest.approx(about, rel=1e-3)
