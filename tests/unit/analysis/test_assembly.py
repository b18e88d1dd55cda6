"""Assembly: branches by guesses, bodies that may and may not move, what stays open."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from generators import cloud, interface
from linkages import bar, four_bar, four_bar_angles, swept
from scipy.spatial.transform import Rotation

import flexmb
from flexmb.analysis.assembly import initial_state
from flexmb.analysis.assembly.gaps import assembly_notes, joint_gaps, moved_bodies
from flexmb.analysis.assembly.initial_state import assemble
from flexmb.analysis.assembly.positions import assembly_weights, length_corrector
from flexmb.engine.allocation import new_state, new_work
from flexmb.engine.compile import compile_system
from flexmb.engine.compiled_calls import solve_stage
from flexmb.engine.initial_conditions import RESIDUAL
from flexmb.errors import AssemblyError, SceneError
from flexmb.model import Model

BARS = (1.0, 2.0, 1.5, 2.2)


def angles(made):
    """Angles of the bodies of an assembled linkage."""
    compiled = compile_system(made)
    q = assemble(compiled, made).state.q
    return np.array([2 * np.arctan2(q[b.iq + 6], q[b.iq + 3]) for b in compiled.layout.bodies])


def driven(placed):
    """A four-bar placed open or crossed, its crank held at 0.6 rad."""
    made = four_bar(BARS, (0.6, *four_bar_angles(BARS, 0.6, placed)))
    made.add_driver("motor", joint="left", angle=0)
    made.add_sensor("right", "angle", joint="right")
    return made


def same_angles(found, expected):
    np.testing.assert_allclose(np.exp(1j * found), np.exp(1j * np.array(expected)), atol=1e-9)


@pytest.mark.parametrize("placed", [1, -1])
@pytest.mark.parametrize("wanted", [1, -1])
def test_a_four_bar_begins_open_or_crossed_as_guessed(placed, wanted):
    expected = (0.6, *four_bar_angles(BARS, 0.6, wanted))
    turn = four_bar_angles(BARS, 0.6, wanted)[1] - four_bar_angles(BARS, 0.6, placed)[1]
    made = driven(placed)
    made.set_assembly(guess={"right": {"angle": float(turn + 0.2)}})
    same_angles(angles(made), expected)
    if placed == 1:  # a kinematic analysis begins there too
        _, rows, _ = swept(made, duration=1e-3, outputs=1)
        q = rows["q"][0]
        first = [2 * np.arctan2(q[7 * b + 6], q[7 * b + 3]) for b in range(3)]
        same_angles(np.array(first), expected)


@pytest.mark.parametrize(("guess", "sign"), [("-100*deg", -1.0), ("100*deg", 1.0)])
def test_an_arm_begins_with_its_elbow_as_guessed(guess, sign):
    """Its hand is held at (1, 0.5). Law of cosines: reach² = 1 + 0.8² + 1.6 cos(elbow)."""
    made = Model("arm", plane="xy")
    bar(made, "upper", 1.0, (0, 0), 0.0)
    bar(made, "fore", 0.8, (1, 0), 0.0)
    made.add_marker("ground.hand", position=[1.0, 0.5, 0])
    made.add_joint("shoulder", "revolute", between=["ground", "upper"], axis="z")
    made.add_joint("elbow", "revolute", between=["upper.end", "fore"], axis="z")
    made.add_joint("grip", "revolute", between=["fore.end", "ground.hand"], axis="z")
    made.set_assembly(guess={"elbow": {"angle": guess}})
    elbow = np.arccos((1.25 - 1.64) / 1.6)
    upper, fore = angles(made)
    assert np.sin(fore - upper) == pytest.approx(sign * np.sin(elbow), abs=1e-9)
    assert np.cos(upper) + 0.8 * np.cos(fore) == pytest.approx(1.0, abs=1e-9)


def gaps_as_placed(compiled):
    """The gaps of a linkage before it is assembled."""
    state, work = new_state(compiled.system), new_work(compiled.system)
    state.q[:] = compiled.initial_q
    solve_stage(compiled.system, state, work, RESIDUAL)
    return joint_gaps(compiled, work)


def weighed(**weights):
    """Angles by which the bars of a four-bar turn, by their weights, and its largest gap."""
    made = four_bar(BARS, (0.7, 0.3, 1.9))
    made.set_assembly(weights=weights)
    compiled = compile_system(made)
    state = assemble(compiled, made).state
    moved = moved_bodies(compiled, compiled.initial_q, state.q)
    turned = {body.name: body.angle for body in moved}
    return [turned.get(name, 0.0) for name in made.bodies], gaps_as_placed(compiled)[0]


def test_heavier_bodies_move_less_and_fixed_ones_not_at_all():
    (free, _), (heavy, _), (fixed, gap) = weighed(), weighed(crank=100), weighed(crank="fixed")
    assert free[0] > 0.05 and heavy[0] < 0.1 * free[0] and fixed[0] == 0.0
    assert fixed[2] > free[2]
    end = np.array([np.cos(0.7) + 2 * np.cos(0.3), np.sin(0.7) + 2 * np.sin(0.3)])
    other = np.array([2.2 + 1.5 * np.cos(1.9), 1.5 * np.sin(1.9)])
    assert (gap.name, gap.distance) == ("joints.rocker_pin", float(np.linalg.norm(end - other)))


def closed_pair(weights, first, offset=(0.0, 0.0, 0.0)):
    """How two bodies 0.1 m apart move to close their joint: changes of their coordinates."""
    made = Model("two")
    made.add_body("b", mass=1.0, inertia=[1, 2, 3], position=[0.1, 0, 0])
    if first is None:
        made.add_body("a", mass=2.0, inertia=[1, 1, 1])
        made.add_marker("a.pin", position=list(offset))
        made.add_marker("b.pin", position=list(offset))
        ends = ["a.pin", "b.pin"]
    else:
        made.add_body("a", first, position=list(-first.interfaces[0].position))
        ends = ["a.pin", "b"]
    made.add_joint("pin", "spherical", between=ends)
    made.set_assembly(weights=dict(zip("ab", weights, strict=True)))
    compiled = compile_system(made)
    state = assemble(compiled, made).state
    return state.q - compiled.initial_q


def test_bodies_share_a_gap_by_mass_and_weight():
    """Least sum of w m d^2: each moves by the share of what the other one counts."""
    moved = closed_pair((1.0, 3.0), None)
    assert moved[7] == pytest.approx(0.1 * 3 / (3 + 2), rel=1e-9)  # a, the second
    assert moved[0] == pytest.approx(-0.1 * 2 / (3 + 2), rel=1e-9)


def test_by_lengths_bodies_share_a_gap_by_weight_alone():
    made = Model("two")
    for name, mass, x in (("b", 1.0, 0.1), ("a", 2.0, 0.0)):
        made.add_body(name, mass=mass, inertia=[1, 1, 1], position=[x, 0, 0])
    made.add_joint("pin", "spherical", between=["a", "b"])
    made.set_assembly(weights={"a": 1.0, "b": 3.0})
    compiled = compile_system(made)
    state = new_state(compiled.system)
    state.q[:] = compiled.initial_q
    corrector = length_corrector(compiled, state, assembly_weights(made))
    for _ in range(5):
        corrector.correct()
    assert state.q[7] == pytest.approx(0.1 * 3 / 4, rel=1e-9)


@pytest.mark.parametrize("kind", ["rigid", "flexible"])
def test_only_ratios_of_weights_count(kind):
    rng = np.random.default_rng(1)
    first = cloud(rng, 3).flexbody("a", [interface(rng, "pin", 3)]) if kind == "flexible" else None
    one, other = (closed_pair(w, first, (0, 0.3, 0.2)) for w in ((1e-9, 1.0), (1.0, 1e9)))
    assert np.abs(one).max() > 0.01
    np.testing.assert_allclose(one, other, atol=1e-12)


def report(made):
    """What the report of an assembly says."""
    compiled = compile_system(made)
    moved = moved_bodies(compiled, compiled.initial_q, assemble(compiled, made).state.q)
    return assembly_notes(gaps_as_placed(compiled), moved, made.units)


def test_the_report_tells_gaps_and_moves_in_the_units_of_the_scene():
    made = four_bar(tuple(1e3 * b for b in BARS), (0.7, 0.3, 1.9), units="mm-t-s")
    made.set_assembly()
    told = report(made)
    assert (
        told[0].startswith("position error before assembly: joints.rocker_pin by ")
        and " mm and 0 deg" in told[0]
    )
    assert told[1].startswith("assembled with least change; moved: rocker by 0 mm and 33")
    assert len(report(driven(1))) == 0


def test_coordinates_of_forces_on_joints_are_no_gaps():
    made = Model("rail")
    made.add_body("cart", mass=1, inertia=[1, 1, 1], position=[0.5, 0.1, 0])
    made.add_joint("rail", "prismatic", between=["ground", "cart"], axis="x")
    made.add_force("spring", "translational-spring-damper", joint="rail", stiffness=10)
    with pytest.raises(AssemblyError, match="joints.rail is open by 0.1 m .*, from ground to cart"):
        assemble(compile_system(made), made)
    made.set_assembly()
    assert report(made)[0] == "position error before assembly: joints.rail by 0.1 m and 0 deg"


def test_a_cross_without_its_second_axis_is_told():
    made = Model("shafts")
    made.add_body("shaft", mass=1, inertia=[1, 1, 1])
    made.add_joint("cross", "universal", between=["ground", "shaft"], axis="x")
    with pytest.raises(AssemblyError, match="90 deg, from ground to shaft: it has no second_axis"):
        assemble(compile_system(made), made)


def test_fixed_bodies_that_would_have_to_move_are_named():
    with pytest.raises(AssemblyError) as caught:
        weighed(crank="fixed", rocker="fixed")
    lines = str(caught.value).splitlines()
    assert [line.split(":")[0] for line in lines] == [
        "assembly.weights.crank", "assembly.weights.rocker",
    ]  # fmt: skip
    assert all("close only if it moves by 0 m and" in line for line in lines)


def test_what_stays_open_is_told_in_the_units_of_the_scene():
    made = four_bar((100.0, 500.0, 100.0, 200.0), (0.7, 0.3, 1.9), units="mm-t-s")
    with pytest.raises(AssemblyError) as caught:
        assemble(compile_system(made), made)
    lines = str(caught.value).splitlines()
    assert "cannot be assembled" in lines[0] and "assembly.guess" in lines[0]
    assert lines[1].startswith("joints.") and " mm and 0 deg" in lines[1]
    assert lines[-1].startswith("assembly: moved in vain: ")


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ({"weights": {"cranc": 1}}, 'weights.cranc: unknown body "cranc"; nearest: crank'),
        ({"weights": {"crank": -1}}, "weights.crank: must be positive"),
        ({"weights": {"crank": "fix"}}, 'given "fix"; allowed: fixed'),
        ({"guess": {"lefty": {"angle": 1}}}, 'guess.lefty: unknown joint "lefty"; nearest: left'),
        ({"guess": {"left": {"stroke": 1}}}, 'joint "left" has no stroke'),
        ({"guess": {"left": {}}}, 'give "angle", "stroke" or both'),
        ({"guess": {"right": {"angle": 1}}}, 'angle is driven by "motor"'),
        ({"wieght": {}}, 'unknown key "wieght"; nearest: weights'),
    ],
)
def test_mistakes_are_named(told, words):
    made = four_bar((1.0, 2.0, 1.5, 2.2), (0.7, 0.3, 1.9))
    made.add_driver("motor", joint="right", angle=0)
    with pytest.raises(SceneError) as caught:
        made.set_assembly(**told)
        made.validate()
    assert "assembly." in str(caught.value) and words in str(caught.value)


def test_sections_are_written_and_read_back():
    made = four_bar((100.0, 200.0, 150.0, 220.0), (0.7, 0.3, 1.9), units="mm-t-s")
    made.set_assembly(weights={"crank": "fixed", "rocker": 3}, guess={"left": {"angle": "30*deg"}})
    made.set_kinematics(duration=2, outputs=7)
    again = Model.from_scene_dict(made.to_scene_dict())
    assert again.assembly == made.assembly and again.kinematics == made.kinematics
    assert again.assembly.guess["left"].angle == pytest.approx(np.pi / 6, rel=1e-15)


def two_bars(gap, units="SI"):
    """A bar on the ground and one at its end, placed too far by a gap; lengths of 1 m."""
    scale = 1.0 if units == "SI" else 1e3
    made = Model("bars", units=units)
    for k, name in enumerate(("one", "two")):
        made.add_body(name, mass=1.0, inertia=[1, 1, 1], position=[(k + k * gap) * scale, 0, 0])
        made.add_marker(f"{name}.end", position=[scale, 0, 0])
    made.add_joint("pin", "revolute", between=["ground", "one"], axis="z")
    made.add_joint("elbow", "revolute", between=["one.end", "two"], axis="z")
    return made


@pytest.mark.parametrize(("units", "distance"), [("SI", "0.3 m"), ("mm-t-s", "300 mm")])
def test_a_body_far_from_where_its_joints_close_is_refused(units, distance):
    made = two_bars(0.3, units)
    for analysis in (flexmb.simulate, flexmb.mobility):
        words = {"duration": 0.1} if analysis is flexmb.simulate else {}
        with pytest.raises(AssemblyError, match="bodies.two: would have to move by") as caught:
            analysis(made, **words)
        assert f"joints.elbow is open by {distance} and 0 deg" in str(caught.value)
    driven = two_bars(0.3)
    driven.add_driver("motor", joint="pin", angle=0.1)
    with pytest.raises(AssemblyError, match="would have to move by") as caught:
        flexmb.mobility(driven)
    assert "drivers.motor" not in str(caught.value)  # it is not out of reach
    made.set_assembly()
    with pytest.warns(match=f"moved: two by {distance}"):
        flexmb.simulate(made, duration=0.01, outputs=1)


def test_each_body_is_named_with_a_joint_of_its_own():
    made = Model("arms")
    for k, name in enumerate(("one", "two")):
        made.add_body(name, mass=1.0, inertia=[1, 1, 1], position=[0.2 + 0.1 * k, 0, 0])
        made.add_joint(f"pin_{name}", "revolute", between=["ground", name], axis="z")
    with pytest.raises(AssemblyError) as caught:
        flexmb.mobility(made)
    two, one = str(caught.value).splitlines()
    assert two.startswith("bodies.two:") and "joints.pin_two is open by 0.3 m" in two
    assert one.startswith("bodies.one:") and "joints.pin_one is open by 0.2 m" in one
    assert "(ground alone is the origin; [ground.markers] names other points)" in one


def test_a_body_that_would_have_to_turn_far_is_refused():
    """A block whose fixed joint is askew turns about its origin, which does not move; so does a
    bar that is placed at its pin, but not towards the other one."""
    block = Model("askew")
    block.add_body("block", mass=1.0, inertia=[1, 1, 1], orientation={"axis": "y", "angle": 1.2})
    block.add_joint("weld", "fixed", between=["ground", "block"])
    bar = two_bars(0.0)
    bar.add_marker("ground.far", position=[1.0, 1.0, 0])
    bar.add_joint("last", "spherical", between=["ground.far", "two.end"])
    for made, body in ((block, "block"), (bar, "two")):
        with pytest.raises(AssemblyError, match=f"bodies.{body}: would have to move by"):
            flexmb.mobility(made)
        made.set_assembly()
        assert flexmb.mobility(made).delta == 0


@pytest.mark.parametrize("angle", [0.02, 0.5, 1.2, np.pi / 2])
@pytest.mark.parametrize("kind", ["fixed", "revolute", "parallel", "perpendicular"])
def test_the_gap_between_axes_is_their_angle(kind, angle):
    """Rows hold cosines; what is said is the angle that they differ by, up to a right one."""
    made = Model("axes")
    turn = angle + (np.pi / 2 if kind == "perpendicular" else 0)
    made.add_body("block", mass=1.0, inertia=[1, 1, 1], orientation={"axis": "x", "angle": turn})
    made.add_joint("hold", kind, between=["ground", "block"])
    said = f"joints.hold.* open by 0 m and {np.degrees(angle):.4g} deg"
    with pytest.raises(AssemblyError, match=said):
        flexmb.mobility(made)


@pytest.mark.parametrize("turn", [[0.3, -0.5, 0.7], [0.0, 1.5, 0.0], [0.4, 0.2, -0.9]])
@pytest.mark.parametrize("kind", ["fixed", "prismatic", "orientation"])
@pytest.mark.parametrize("between", [["ground", "block"], ["block", "ground"]])
def test_the_gap_of_a_joint_without_turns_is_the_rotation_between_its_sides(kind, turn, between):
    """Tilt and twist were added: 73.6 deg from one side and 39.9 deg from the other, for 52.2."""
    made = Model("turned")
    made.add_body("block", mass=1.0, inertia=[1, 1, 1],
                  orientation=Rotation.from_rotvec(turn).as_matrix().tolist())  # fmt: skip
    made.add_joint("hold", kind, between=between)
    said = f"joints.hold is open by 0 m and {np.degrees(np.linalg.norm(turn)):.4g} deg"
    with pytest.raises(AssemblyError, match=said):
        flexmb.mobility(made)


def test_a_small_gap_is_closed_and_said_so():
    with pytest.warns(match=r"assembled with least change; moved: two by 0.004 m"):
        flexmb.simulate(two_bars(0.004), duration=0.01, outputs=1)
    with warnings.catch_warnings():  # round-off is no gap
        warnings.simplefilter("error")
        flexmb.simulate(two_bars(1e-9), duration=0.01, outputs=1)


def test_drivers_say_where_bodies_begin_without_an_assembly():
    made = two_bars(0.0)
    made.add_driver("motor", joint="pin", angle="1 + t")
    made.add_driver("fold", joint="elbow", angle="2 - t")
    with pytest.warns(match=r"moved: two by 0\.95\d+ m and 171\.9 deg"):
        flexmb.kinematics(made, duration=0.1, outputs=1)


@pytest.mark.parametrize("coupling", ["constant", "partial", "full"])
def test_the_weight_of_a_flexible_body_counts_for_its_inertia_alone(coupling):
    rng = np.random.default_rng(6)
    made, part = Model("a part on a hinge"), cloud(rng, 5).flexbody("a", [interface(rng, "pin", 5)])
    made.add_body("part", part, inertia_coupling=coupling)
    made.add_joint("hinge", "revolute", between=["ground", "part.pin"], axis="z")
    system = compile_system(made).system
    pool, markers = system.parts.pool, system.parts.markers["modes"]
    weighted = initial_state._weighted(system, np.array([3.0])).parts.pool
    body = system.parts.bodies[0]
    stiffness = body["flex"] + 12 * body["m"] + body["m"] ** 2 + np.arange(2 * body["m"] ** 2)
    shapes = np.arange(markers[markers >= 0].min(), len(pool))
    same = np.concatenate([stiffness, shapes])
    inertia = np.setdiff1d(np.arange(body["flex"], shapes[0]), same)
    np.testing.assert_array_equal(weighted[same], pool[same])
    np.testing.assert_array_equal(weighted[inertia], 3.0 * pool[inertia])


def test_a_plate_on_redundant_joints_sags_into_its_elastic_equilibrium():
    """A hatch on two hinges and two cylinders, which hold it by lever arms."""
    made = Model("hatch", gravity=[0, 0, -9.81])
    places = {"h1": [0, -1, 0], "h2": [0, 1, 0], "eye1": [1.25, -0.75, 0], "eye2": [1.25, 0.75, 0]}
    made.add_body(
        "cover",
        mesh={"type": "plate", "length": 3.0, "width": 2.0, "divisions": [12, 8]},
        sections={"all": {"type": "shell", "thickness": 0.012}},
        material="steel",
        interfaces={name: {"center": x, "radius": 0.3} for name, x in places.items()},
        modes=8,
    )
    for side in (1, 2):
        made.add_marker(f"ground.h{side}", position=places[f"h{side}"])
        made.add_marker(f"ground.f{side}", position=[0.3, places[f"eye{side}"][1], -1.0])
        rod = {"between": [f"ground.f{side}", f"cover.eye{side}"], "distance": np.hypot(0.95, 1)}
        made.add_driver(f"ram{side}", **rod)
    made.add_joint("h1", "revolute", between=["ground.h1", "cover.h1"], axis="y")
    made.add_joint("h2", "spherical", between=["ground.h2", "cover.h2"])
    run = flexmb.simulate(made, duration=0.01, outputs=1, start="quasi-static")
    arm = 1.25 * np.sin(np.arctan2(1.0, 0.95))
    weight = 3 * 2 * 0.012 * 7850 * 9.81
    forces = [np.linalg.norm(run.reaction(f"ram{side}").force[0]) for side in (1, 2)]
    assert sum(forces) == pytest.approx(weight * 1.5 / arm, rel=2e-3)
    assert run.drift[0].max() < 1e-9


def test_a_mesh_that_is_placed_far_from_its_joints_is_refused_by_the_check(tmp_path):
    """Before it is reduced: its stand-in is rigid, but no deformation makes good for so much."""
    text = (
        "[bodies.bar]\nmesh = { type = 'box', size = [1, 0.1, 0.1] }\nmaterial = 'steel'\n"
        "interfaces = { a = 'x0', b = 'x1' }\n[ground.markers]\nfar = { position = [%s, 0, 0] }\n"
        "[joints]\na = { type = 'fixed', between = ['ground', 'bar.a'] }\n"
        "b = { type = 'fixed', between = ['ground.far', 'bar.b'] }\n[statics]\n"
    )
    scene = tmp_path / "scene.toml"
    scene.write_text(text % 1.05)
    with pytest.raises(AssemblyError, match=r"joints\.b"):
        flexmb.check_scene(scene)
    scene.write_text(text % 1.001)
    notes = flexmb.check_scene(scene).notes
    assert any(note.startswith("if the flexible bodies are rigid: joints.") for note in notes)
