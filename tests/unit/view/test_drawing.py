"""What a drawing holds: a glyph for each joint, deformation from the joints, cameras, arrows."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import slidercrank
from resultfiles import FakeBody, FakeLayout

from flexmb import simulate
from flexmb.errors import ViewError
from flexmb.flexbody import FlexBody, Interface, Surface, save
from flexmb.flexbody.stress_modes import StressModes
from flexmb.model import Model
from flexmb.model.joints.joint import JOINT_TYPES
from flexmb.model.surface_mesh import open_edges
from flexmb.results import Result
from flexmb.results.output_block import OutputBlock
from flexmb.results.writer import ResultWriter
from flexmb.view.arrows import vectors
from flexmb.view.content import DAMPER, FRICTION, HOUSING, RUBBER, Content
from flexmb.view.drawing import Drawing
from flexmb.view.joint_shapes import _LINKS as LINKS
from flexmb.view.mechanism import Display, Mechanism, applied
from flexmb.view.picture import view_of


@pytest.fixture(scope="module")
def crank(tmp_path_factory: pytest.TempPathFactory) -> Mechanism:
    return Mechanism(Result(slidercrank.make(tmp_path_factory.mktemp("run"))))


def compose(mechanism: Mechanism, **words) -> Content:
    return Drawing(mechanism, view_of(mechanism, words)).content()


def cantilever(n: int = 20) -> FlexBody:
    """A strip of unit length in its mean axes: bent as x**2 less the rigid motion of its mean."""
    x = np.linspace(0.0, 1.0, n + 1)
    points = np.concatenate([np.column_stack([x, y + 0 * x, 0 * x]) for y in (-0.05, 0.05)])
    k = np.arange(n)
    faces = np.vstack(
        [np.column_stack([k, k + 1, k + n + 2]), np.column_stack([k, k + n + 2, k + n + 1])]
    )
    bend = points[:, 0] ** 2 - points[:, 0] + 1 / 6
    modes = np.zeros((len(points), 3, 1))
    modes[:, 2, 0] = bend
    return FlexBody(
        name="beam", mass=1.0, S1=np.array([0.5, 0, 0]),
        S0=np.diag([1 / 3, 1e-3, 1e-3]), p=np.zeros((3, 1)), P=np.zeros((3, 3, 1)),
        Mab=np.diag([0.0, 0.0, 1 / 180])[:, :, None, None], K=np.array([[1.0]]),
        interfaces=(Interface("root", np.zeros(3), np.array([[0.0], [0.0], [1 / 6]]),
                              np.array([[0.0], [1.0], [0.0]])),
                    Interface("tip", np.array([1.0, 0, 0]), np.array([[0.0], [0.0], [1 / 6]]),
                              np.array([[0.0], [-1.0], [0.0]]))),
        surface=Surface(points, faces, np.zeros((0, 2), dtype=int), modes, np.arange(len(points))),
    )  # fmt: skip


def still_run(model: Model, folder: Path, eta: tuple[float, ...] = (), **places) -> Mechanism:
    """A result of two equal rows: bodies where the model places them, or at `places` r and p."""
    bodies, iq, iv = [], 0, 0
    for name, spec in model.bodies.items():
        m = len(eta) if spec.flexible else 0
        bodies.append(FakeBody(name, iq, iv, m))
        iq, iv = iq + 7 + m, iv + 6 + m
    layout = FakeLayout(tuple(bodies), iq, iv, 0, (), (), (), model.channels(), ())
    q = np.zeros((2, iq))
    for body in bodies:
        spec = model.bodies[body.name]
        r, p = places.get(body.name, (spec.position, spec.orientation))
        q[:, body.iq : body.iq + 7] = [*r, *p]
        if body.m:
            q[:, body.iq + 7 : body.iq + 7 + body.m] = eta
    zeros = {name: np.zeros((2, n)) for name, n in (
        ("v", iv), ("vd", iv), ("lam", 0), ("drift", 2), ("reactions", 0),
        ("sensors", len(layout.channels)), ("energy", 0))}  # fmt: skip
    files = {name: f"{name}.flexbody.h5" for name, spec in model.bodies.items() if spec.flexible}
    scene = model.to_scene_dict(folder, files)
    with ResultWriter(folder / "result.h5", layout, 2, scene=scene, flexbodies=files) as out:
        out.append(OutputBlock(t=np.array([0.0, 1.0]), q=q, **zeros))
        out.finish({}, "finished", "")
    return Mechanism(Result(out.path))


ETA = 0.01


@pytest.fixture(scope="module")
def clamped(tmp_path_factory: pytest.TempPathFactory) -> Mechanism:
    """That strip clamped to ground, bent to z = 0.01 x**2, and a weight at its tip."""
    folder = tmp_path_factory.mktemp("clamped")
    save(cantilever(), folder / "beam.flexbody.h5")
    model = Model("A clamped strip", folder=folder)
    model.add_body("beam", flexbody="beam.flexbody.h5")
    model.add_body("weight", mass=1, inertia=[1e-3] * 3, position=[1, 0, 0])
    model.add_joint("clamp", "fixed", between=["ground", "beam.root"])
    model.add_joint("hook", "fixed", between=["beam.tip", "weight"])
    half = -0.5 * ETA  # the mean axes are turned so that the root is level
    beam = (0.0, 0.0, -ETA / 6), (np.cos(half), 0.0, np.sin(half), 0.0)
    weight = (1.0, 0.0, ETA), (np.cos(ETA), 0.0, -np.sin(ETA), 0.0)
    return still_run(model, folder, (ETA,), beam=beam, weight=weight)


def test_a_clamped_edge_is_not_displaced_and_the_tip_by_its_deflection(clamped) -> None:
    _, undeformed, displacement = Display(clamped, 1.0).surface("beam")
    x = clamped.flexbodies["beam"].surface.points[:, 0]
    np.testing.assert_allclose(displacement, ETA * x**2, atol=2 * ETA**2)
    assert displacement[x == 0].max() < 1e-15
    np.testing.assert_allclose(undeformed[:, 2], 0.0, atol=ETA**2)


def test_what_hangs_on_an_exaggerated_body_is_carried_along(clamped) -> None:
    display = Display(clamped, 20.0)
    points, _, _ = display.surface("beam")
    x = clamped.flexbodies["beam"].surface.points[:, 0]
    np.testing.assert_allclose(points[x == 0][:, 2], 0.0, atol=ETA**3)
    np.testing.assert_allclose(display.point("weight"), display.point("beam.tip"), atol=ETA**2)
    assert display.point("weight")[2] == pytest.approx(20 * ETA, rel=0.02)
    tilt = display.frame("weight")[:3, 0]
    assert np.arctan2(tilt[2], tilt[0]) == pytest.approx(20 * 2 * ETA, rel=0.02)


def test_the_reference_is_chosen_by_name(clamped) -> None:
    root = clamped.flexbodies["beam"].surface.points[:, 0] == 0
    for references, expected in (((), 0.0), (("mean-axes",), ETA / 6), (("beam.tip",), ETA)):
        _, _, displacement = Display(clamped, 1.0, references).surface("beam")
        assert displacement[root].min() == pytest.approx(expected, abs=2 * ETA**2)
    assert "(beam, from beam.root)" in compose(clamped).caption
    assert "(beam, from mean axes)" in compose(clamped, reference="mean-axes").caption


def test_the_factor_one_moves_nothing(crank: Mechanism) -> None:
    display = Display(crank, 1.0)
    for name in crank.model.bodies:
        pose = crank.pose(name)
        points = np.array([[0.1, 0.2, 0.3]])
        if name != "rod":
            np.testing.assert_allclose(
                applied(display.frame(name), points), points @ pose.A.T + pose.r
            )
    surface = crank.flexbodies["rod"].surface
    pose = crank.pose("rod")
    drawn, _, _ = display.surface("rod")
    true = pose.r + (surface.points + surface.modes @ pose.eta) @ pose.A.T
    np.testing.assert_allclose(drawn, true, atol=1e-12)


def joint_model(kind: str, folder: Path) -> Mechanism:
    model, row = Model(kind, folder=folder), JOINT_TYPES[kind]
    model.add_curve("c", x="0.5*cos(t)", y="0.3*sin(t)", closed=True)
    model.add_body("a", mass=1, inertia=[1, 1, 1], position=[1, 0, 0])
    model.add_body("b", mass=1, inertia=[1, 1, 1], position=[1, 0, 0])
    model.add_marker("b.end", position=[0.4, 0.3, 0])
    model.add_marker("a.far", position=[-1, 0, 0])
    model.add_joint("foot", "revolute", between=["ground", "a.far"], axis="z")
    between = ["a", "b.end"] if kind in LINKS or row.curves else ["a", "b"]
    words = {"axis": "x"} if row.axes else {}
    words |= {"second_axis": "y"} if row.axes > 1 else {}
    words |= {"pitch": 0.1} if kind == "screw" else {}
    words |= {"curve": "c"} if row.curves else {}
    words |= {"second_curve": "c"} if row.curves > 1 else {}
    words |= {"radius": 0.1} if kind == "cam-roller" else {}
    model.add_joint("j", kind, between=between, **words)
    return still_run(model, folder)


@pytest.mark.slow
def test_every_joint_has_a_glyph_of_its_own(tmp_path: Path) -> None:
    seen: dict[tuple, str] = {}
    for kind, row in JOINT_TYPES.items():
        folder = tmp_path / kind
        folder.mkdir()
        mechanism = joint_model(kind, folder)
        drawing = Drawing(mechanism)
        if row.curves:
            continue  # its curves and followers belong to the bodies: test_curve_shapes.py
        parts = [part for part in drawing.parts if part.name == "j"]
        solids = [part.solid(drawing.display()) for part in parts]
        points = np.vstack([solid.points for solid in solids])
        assert np.abs(points - mechanism.point("a")).max(axis=1).min() < 3 * drawing.pin
        assert drawing.pin < 0.05 * drawing.size
        shape = tuple(
            (
                part.shape.points.shape[0],
                *np.round(np.ptp(part.shape.points, axis=0) / drawing.pin, 1),
            )
            for part in parts
        )
        assert seen.setdefault(shape, kind) == kind


def test_bumpers_stand_where_a_slide_stops_and_the_rail_reaches_them(tmp_path: Path) -> None:
    model = Model("stops", folder=tmp_path)
    model.add_body("b", mass=1, inertia=[1, 1, 1], shape={"type": "box", "size": [1, 1, 1]})
    model.add_joint("j", "prismatic", between=["ground", "b"], axis="z")
    model.add_force("s", "translational-stop", joint="j", lower=-2, upper=3, stiffness=1e3)
    mechanism = still_run(model, tmp_path)
    drawing = Drawing(mechanism)
    r, display = drawing.pin, drawing.display()
    heights = {
        name: np.vstack([p.solid(display).points for p in drawing.parts if p.name == name])[:, 2]
        for name in "js"
    }
    inner = heights["s"][heights["s"] > 0].min(), heights["s"][heights["s"] < 0].max()
    np.testing.assert_allclose(inner, (3 + 1.8 * r, -2 - 1.8 * r), atol=1e-12)  # of the sleeve
    assert heights["j"].max() > inner[0]
    assert heights["j"].min() < inner[1]


def test_the_peg_of_an_angle_touches_its_stop_there(tmp_path: Path) -> None:
    for angle in (-0.4, 0.9):
        model = Model("stops", folder=tmp_path)
        model.add_body("b", mass=1, inertia=[1, 1, 1], shape={"type": "box", "size": [1, 1, 1]})
        model.add_joint("j", "revolute", between=["ground", "b"], axis="z")
        model.add_force("s", "rotational-stop", joint="j", lower=-0.4, upper=0.9, stiffness=1e3)
        model.add_force(
            "f",
            "joint-friction",
            joint="j",
            dynamic=0.1,
            radius=0.1,
            model="smooth",
            creep_speed=0.1,
        )
        model.add_driver("d", joint="j", angle=f"{angle}*t")
        run = simulate(model, duration=1.0, output=tmp_path)
        drawing = Drawing(Mechanism(run, 1.0))
        parts = {part.color: part for part in drawing.parts if part.name == "s"}
        solid = [parts[color].solid(drawing.display()) for color in (RUBBER, HOUSING)]
        blocks, peg = (s.points[:, :2] for s in solid)
        apart = np.linalg.norm(blocks[:, None] - peg[None], axis=2).min()
        assert apart < 0.6 * drawing.pin, angle
        assert {part.color for part in drawing.parts if part.name == "f"} == {DAMPER, FRICTION}


@pytest.mark.parametrize(
    ("motion", "force"),
    [
        ({"z": "1.5*t**2"}, [0, 0, 2 * (10 + 3)]),
        ({"joint": "j", "stroke": "1.5*t**2"}, [2 + 40 / 9, 4 + 80 / 9, 4 + 80 / 9]),
        ({"between": ["ground.up", "b"], "distance": "2 - 0.25*t**2"}, [0, 0, 2 * (10 + 0.5)]),
    ],
)
def test_the_arrow_of_a_driver_is_its_force_in_global_axes(motion, force, tmp_path) -> None:
    model = Model("driven", folder=tmp_path, gravity=[0, 0, -10])
    model.add_marker("ground.up", position=[0, 0, 2])
    model.add_body("b", mass=2, inertia=[1, 1, 1])
    if "joint" in motion:
        model.add_joint("j", "prismatic", between=["ground", "b"], axis=[1, 2, 2])
    else:
        motion = motion if "between" in motion else {"marker": "b", **motion}
    model.add_driver("d", **motion)
    result = simulate(model, duration=1.0, output=tmp_path)
    arrows = [v for v in vectors(Mechanism(result, 0.5), "reactions") if v.name == "d"]
    np.testing.assert_allclose(next(v.value for v in arrows if not v.torque), force, rtol=1e-5)


def test_the_arrow_of_a_force_on_a_joint_is_along_its_axis(tmp_path) -> None:
    model = Model("pushed", folder=tmp_path)
    model.add_body("b", mass=2, inertia=[1, 1, 1])
    model.add_joint("j", "prismatic", between=["ground", "b"], axis=[1, 2, 2])
    model.add_force("s", "translational-spring-damper", joint="j", value=6)
    result = simulate(model, duration=1.0, output=tmp_path)
    arrows = [v for v in vectors(Mechanism(result, 0.5), "reactions") if v.name == "s"]
    np.testing.assert_allclose(next(v.value for v in arrows if not v.torque), [2, 4, 4])


def test_the_teeth_of_two_wheels_do_not_meet(tmp_path: Path) -> None:
    for teeth, internal in (((20, 33), False), ((17, 40), True)):
        model = Model("gears", folder=tmp_path)
        distance = 0.5 * (teeth[1] - teeth[0] if internal else sum(teeth)) * 0.01
        model.add_marker("ground.second", position=[0.6 * distance, 0.8 * distance, 0])
        model.add_body("first", mass=1, inertia=[1, 1, 1])
        model.add_body(
            "second", mass=1, inertia=[1, 1, 1], position=[0.6 * distance, 0.8 * distance, 0]
        )
        model.add_joint("a", "revolute", between=["ground", "first"], axis="z")
        model.add_joint("b", "revolute", between=["ground.second", "second"], axis="z")
        model.add_coupler("g", "gear", joints=["a", "b"], teeth=list(teeth), internal=internal)
        drawing = Drawing(still_run(model, tmp_path))
        wheels = {part.name: part for part in reversed(drawing.parts)}  # lumps stand behind them
        first, second = (
            wheels[name].solid(drawing.display()).points for name in ("first", "second")
        )
        center = np.array([0.6 * distance, 0.8 * distance])
        pitch = [0.005 * n for n in teeth]
        # along the line of centres a tooth of one lies in a gap of the other
        line = np.array([0.6, 0.8]) * (-1 if internal else 1)
        reach = []
        for points, middle, towards in (
            (first, 0 * center, line),
            (second, center, line if internal else -line),
        ):
            local = points[:, :2] - middle
            angle = np.abs(np.angle((local[:, 0] + 1j * local[:, 1]) / complex(*towards)))
            reach.append(np.linalg.norm(local, axis=1)[angle < 0.25 * np.pi / min(teeth)])
        touch = reach[0].max() - pitch[0] if len(reach[0]) else 0.0
        other = (
            (pitch[1] - reach[1].min() if internal else reach[1].max() - pitch[1])
            if len(reach[1])
            else 0.0
        )
        assert touch + other <= 0.011


def test_standard_views_are_those_of_a_drawing(crank: Mechanism) -> None:
    """The crank's plane is xy, its axes z: front along z, right along x, top along y."""
    views = {"front": (0, 0, 1), "right": (1, 0, 0), "top": (0, 1, 0), "back": (0, 0, -1)}
    for name, towards in views.items():
        camera = compose(crank, camera=name).camera
        np.testing.assert_allclose(camera.direction, towards, atol=1e-12)
    np.testing.assert_allclose(compose(crank, camera="top").camera.axes[0], [1, 0, 0], atol=1e-12)
    drawing = Drawing(crank, view_of(crank, {"camera": ["front", "top"]}))
    assert len(drawing.contents()) == 2


@pytest.mark.parametrize(("height", "above"), [(1.0, False), (0.05, True)])
def test_upright_axes_are_looked_along_at_flat_machines_alone(height, above, tmp_path) -> None:
    model = Model("slewing", folder=tmp_path, gravity=[0, 0, -10])
    shape = {"type": "box", "size": [1, 0.1, height]}
    model.add_body("jib", shape=shape, density=1000)
    model.add_joint("slew", "revolute", between=["ground", "jib"], axis="z")
    machine = Mechanism(simulate(model, duration=0.1, outputs=2, output=tmp_path), 0.1)
    camera = compose(machine).camera
    assert (camera.direction[2] > 0.9) == above
    assert camera.up == ((0, 1, 0) if above else (0, 0, 1))
    front = compose(machine, camera="front").camera
    assert (front.direction, front.up) == ((0, -1, 0), (0, 0, 1))


def test_arrows_have_the_scale_of_the_caption(tmp_path: Path) -> None:
    model = Model("loads", folder=tmp_path)
    model.add_body("b", mass=1, inertia=[1, 1, 1], shape={"type": "box", "size": [1, 1, 1]})
    model.add_force("push", "force", at="b", value=[0, 30, 40])
    model.add_force("twist", "torque", at="b", value=[0, 0, 7])
    mechanism = still_run(model, tmp_path)
    drawing = Drawing(mechanism, view_of(mechanism, {"forces": "loads"}))
    content = drawing.content()
    length = 0.2 * drawing.size
    assert "force 50 N, torque 10 N m" in content.caption
    push, twist = (solid for solid in content.solids if solid.role == "arrow")
    tip = push.points @ np.array([0, 0.6, 0.8])
    assert tip.max() == pytest.approx(length, rel=1e-6)  # 50 N
    assert np.ptp(twist.triangles.points[:, :2], axis=0).max() > 0.5 * length


def test_a_film_has_one_view_and_a_picture_may_frame_its_moment(crank: Mechanism) -> None:
    motion = Drawing(crank, view_of(crank, {"framing": "motion"}))
    first, last = motion.content(0.0).extent, motion.content(0.0133).extent
    np.testing.assert_allclose(np.ptp(first, axis=0), np.ptp(last, axis=0))
    moment = compose(crank, framing="moment").extent
    assert np.ptp(moment, axis=0)[1] < 0.8 * np.ptp(first, axis=0)[1]
    for words in (
        {"camera": "frnt"}, {"follow": "rodd"}, {"reference": "rod.end"}, {"labels": "a"},
        {"layer": "top"}, {"camera": "top", "direction": "x"}, {"zoom": 0}, {"colour": 1},
    ):  # fmt: skip
        with pytest.raises(ViewError):
            view_of(crank, words)


def test_names_are_those_of_bodies_and_joints(crank: Mechanism) -> None:
    texts = {label.text for label in compose(crank, labels="all").labels}
    assert texts == {*crank.model.bodies, *crank.model.joints}
    assert not compose(crank).labels


@pytest.mark.parametrize("times", [None, [0.0, 1.0]])
def test_a_body_that_never_bends_has_its_own_colour(clamped, tmp_path: Path, times) -> None:
    """As in kinematics, where flexible bodies are rigid: no colour bar from 0 to 1 nm."""
    save(cantilever(), tmp_path / "beam.flexbody.h5")
    model = Model("A strip", folder=tmp_path)
    model.add_body("beam", flexbody="beam.flexbody.h5")
    stiff = Drawing(still_run(model, tmp_path, (0.0,)), times=times)
    content = stiff.content()
    assert stiff.scale is None
    assert content.deformed[0].values is None
    assert "displacement" not in content.caption
    bent = Drawing(clamped, times=times)
    assert bent.scale is not None
    assert "displacement" in bent.content().caption


def test_colours_stand_where_the_strip_is_displaced(clamped, tmp_path: Path) -> None:
    """Seen from above the left end is dark blue (least), the right end yellow (largest)."""
    from PIL import Image

    from flexmb.view import vtk_renderer
    from flexmb.view.picture import render

    if not vtk_renderer.probe().works:
        pytest.skip("VTK does not render on this machine")
    path = render(clamped.result, output=tmp_path / "a.png", direction="z", size=(480, 270))
    pixels = np.asarray(Image.open(path).convert("RGB"), float)
    assert pixels.shape == (270, 480, 3)
    row = pixels[120:190, :400]
    saturated = np.ptp(row, axis=2) > 60
    purple = saturated & (row[..., 2] > row[..., 1] + 25) & (row[..., 0] < 110)
    yellow = saturated & (row[..., 0] > 190) & (row[..., 1] > 180) & (row[..., 2] < 110)
    columns = [np.flatnonzero(mask.any(axis=0)) for mask in (purple, yellow)]
    assert len(columns[0]) and len(columns[1])
    assert columns[0].mean() < columns[1].mean() - 80


def stressed_plate(folder: Path) -> Mechanism:
    """The strip as a plate 20 mm thick with a compression of 3 MPa along x at its lower face."""
    body = cantilever()
    ids = np.unique(body.surface.node_ids)
    modes = np.zeros((len(ids), 6, 1), dtype=np.float32)
    modes[:, 0, 0] = -3e8  # eta = 0.01
    zeros = np.zeros(len(ids), dtype=int)
    stress = StressModes(ids, zeros, zeros, ("all",), ("bottom",), modes)
    facts = {
        "material": json.dumps({"E": 210e9, "nu": 0.3}),
        "sections": json.dumps({"all": {"layers": [{"thickness": 0.02}], "offset": 0.0}}),
    }
    save(replace(body, stress=stress, provenance=facts), folder / "beam.flexbody.h5")
    model = Model("A plate", folder=folder)
    model.add_body("beam", flexbody="beam.flexbody.h5")
    model.add_joint("clamp", "fixed", between=["ground", "beam.root"])
    return still_run(model, folder, (ETA,))


def test_stress_and_strain_energy_follow_from_uniaxial_stress(tmp_path: Path) -> None:
    """One axis: the principal stress is the stress, with its sign; the energy sigma^2 / (2 E)."""
    mechanism = stressed_plate(tmp_path)
    expected = {"von_mises": 3e6, "principal": -3e6, "strain_energy": 9e12 / 420e9}
    for color, value in expected.items():
        content = compose(mechanism, color=color)
        np.testing.assert_allclose(content.deformed[0].values, value, rtol=1e-6)
        assert content.scale.largest == pytest.approx(abs(value), rel=1e-6)
    assert "largest principal stress -3 MPa (beam)" in compose(mechanism, color="principal").caption
    with pytest.raises(ViewError, match="bottom"):
        compose(mechanism, color="von_mises", layer="botom")


def test_a_plate_is_drawn_with_its_thickness(tmp_path: Path) -> None:
    mechanism = stressed_plate(tmp_path)
    (body,) = compose(mechanism, exaggeration=0).deformed
    points = body.points
    assert np.ptp(points[:, 2]) == pytest.approx(0.02 + ETA, rel=0.02)  # the root is tilted
    a, b, c = (points[body.faces[:, k]] for k in range(3))
    volume = float(np.einsum("ti,ti->", np.cross(a, b), c) / 6)
    assert abs(volume) == pytest.approx(1.0 * 0.1 * 0.02, rel=1e-3)
    assert open_edges(body.faces) == 0
