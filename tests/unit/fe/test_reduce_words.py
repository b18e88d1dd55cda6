"""The words of a reduction in the one call: methods, modes, interfaces, loads; its fingerprint."""

from __future__ import annotations

import meshio
import numpy as np
import pytest
from femeshes import block

import flexmb
from flexmb.errors import FlexmbError
from flexmb.fe import reduce
from flexmb.fe.reduction.methods import reduction_key
from flexmb.flexbody import load, save

BOX = block((2, 1, 1), (0.4, 0.1, 0.07))
SOFT = {"left": "x0", "right": {"group": "x1", "type": "rbe3"}}
LOADS = {
    "press": {"type": "pressure", "group": "x1", "pressure": 1e5},
    "weight": {"type": "gravity", "acceleration": [0, 0, -9.81]},
}


def body(**words):
    return reduce(BOX, material="steel", **{"interfaces": SOFT, "modes": 4} | words)


@pytest.mark.parametrize(
    ("words", "count"),
    [
        ({}, 12 + 4 - 6),
        ({"reduction": "guyan", "modes": None}, 6),
        ({"reduction": "free-interface"}, 4 + 12),
        ({"modes": {"count": 7}}, 12 + 7 - 6),
        ({"loads": LOADS}, 12 + 4 - 6 + 1),  # the pressure is a force of the interface at x1
        ({"loads": LOADS | {"press": LOADS["press"] | {"group": "x0"}}}, 12 + 4 - 6 + 1),
        ({"loads": {"press": {**LOADS["press"], "residual": False}}}, 12 + 4 - 6),
        ({"interfaces": None}, 4),
        ({"interfaces": None, "loads": LOADS}, 5),
    ],
)
def test_coordinates_of_each_method(words, count):
    assert body(**words).m == count


def test_loads_are_kept_in_the_body_and_its_file(tmp_path):
    """Work of the load on a mode, from the mode at the face: int -p n . phi dA with areas."""
    made = body(loads=LOADS)
    stored = load(save(made, tmp_path / "box.flexbody.h5"))
    press, weight = stored.loads
    assert (press.name, weight.name) == ("press", "weight")
    np.testing.assert_allclose(press.force, [-1e5 * 0.1 * 0.07, 0, 0], atol=1e-8)
    np.testing.assert_allclose(weight.force, [0, 0, -9.81 * made.mass], rtol=1e-12)
    assert np.abs(weight.modal).max() < 1e-9 * np.linalg.norm(weight.force)
    mesh = BOX
    faces = mesh.blocks["triangle6"][mesh.element_sets["x1"]["triangle6"]]
    middles = faces[:, 3:]  # a six-node triangle gives its load to the mid-side nodes alone
    rows = np.array([[made.nodes.row(node) for node in face] for face in middles])
    area = 0.1 * 0.07 / len(faces)
    wanted = -1e5 * area / 3 * made.nodes.Phi_t[rows, 0].sum(axis=(0, 1))
    np.testing.assert_allclose(press.modal, wanted, atol=1e-9 * np.abs(wanted).max())


def test_user_modes_in_millimetres_are_those_in_metres(tmp_path):
    free = reduce(BOX, material="steel", modes=5)
    shapes = np.zeros((len(BOX.points), 3, 5))
    shapes[free.nodes.ids] = free.nodes.Phi_t
    np.savez(tmp_path / "modes.npz", modes=1e3 * shapes)
    ends = {"right": SOFT["right"]}
    words = {"material": "steel", "reduction": "user", "interfaces": ends}
    metres = reduce(BOX, modes=shapes, **words)
    millimetres = reduce(
        BOX.scaled(1e3), units="mm-t-s", modes=str(tmp_path / "modes.npz"), **words
    )
    np.testing.assert_allclose(metres.frequencies, free.frequencies, rtol=1e-9)
    np.testing.assert_allclose(millimetres.frequencies, free.frequencies, rtol=1e-9)


def test_the_fingerprint_tells_methods_modes_and_loads_apart(tmp_path):
    cells = [(kind, nodes) for kind, nodes in BOX.blocks.items()]
    path = tmp_path / "box.vtu"
    meshio.write_points_cells(path, BOX.points, cells)
    np.savez(tmp_path / "modes.npz", modes=np.eye(3))
    np.savez(tmp_path / "others.npz", modes=2 * np.eye(3))
    choices = [
        {},
        {"modes": 19},
        {"modes": {"frequency": 100.0}},
        {"modes": {"effective_mass": 0.9}},
        {"reduction": "free-interface"},
        {"reduction": "guyan"},
        {"reduction": "user", "modes": np.eye(4)},
        {"reduction": "user", "modes": tmp_path / "modes.npz"},
        {"reduction": "user", "modes": tmp_path / "others.npz"},
        {"loads": LOADS},
        {"interfaces": {"a": {"group": "x1", "type": "rbe3", "position": np.zeros(3)}}},
        {"interfaces": {"a": {"group": "x1"}}},
    ]
    keys = [reduction_key(path, material="steel", **words) for words in choices]
    assert len(set(keys)) == len(keys)
    same = {"reduction": "craig-bampton", "modes": {"count": 20}, "loads": {}}
    assert reduction_key(path, material="steel", **same) == keys[0]
    same = {"reduction": "user", "modes": np.eye(3)}
    assert reduction_key(path, material="steel", **same) == keys[7]


def test_mistakes_of_method_and_damping_are_told_before_anything_is_assembled():
    phases = []
    with pytest.raises(FlexmbError) as told:
        reduce(
            BOX,
            material="steel",
            interfaces=SOFT,
            reduction="guyen",
            damping=2.0,
            progress=lambda phase, *rest: phases.append(phase),
        )
    assert [problem.where for problem in told.value.problems] == ["reduction", "damping"]
    assert "nearest: guyan" in str(told.value)
    assert phases == []
    with pytest.raises(FlexmbError, match="loads.push.group: is missing"):
        body(loads={"push": {"type": "pressure", "pressure": 1.0}})


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ({"sections": "rectangle"}, "sections: a table by name is expected, given 'rectangle'"),
        ({"interfaces": ["start"]}, "interfaces: a table by name is expected, given .'start'."),
        ({"loads": [1]}, "loads: a table by name is expected, given"),
        ({"ties": {"t": "start"}}, "ties.t: a table is expected, given 'start'"),
        ({"mesh": None}, "mesh: is missing"),
    ],
)
@pytest.mark.parametrize("solve", [flexmb.reduce, flexmb.part])
def test_what_is_no_table_is_told(solve, words, sentence):
    beam = {
        "mesh": {"type": "beam", "length": 1},
        "material": "steel",
        "sections": {"all": {"type": "circle", "radius": 0.01}},
    }
    with pytest.raises(flexmb.FlexmbError, match=sentence):
        solve(**(beam | words))
