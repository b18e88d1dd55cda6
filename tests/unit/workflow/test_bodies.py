"""The files of flexible bodies: one each, on systems too that do not tell "Rod" from "rod"."""

from __future__ import annotations

import numpy as np

from flexmb.flexbody import FlexBody
from flexmb.model import Model
from flexmb.workflow import flexible_bodies


def _body(mass: float) -> FlexBody:
    P, Mab = np.zeros((3, 3, 1)), np.zeros((3, 3, 1, 1))
    P[0, 0], Mab[0, 0] = 0.5, 1.0
    K = np.array([[1e4]])
    return FlexBody("part", mass, np.zeros(3), np.eye(3), np.zeros((3, 1)), P, Mab, K)


def test_bodies_whose_names_differ_in_case_only_have_files_of_their_own(tmp_path) -> None:
    model = Model("names")
    for name, mass in (("Rod", 1.0), ("rod", 2.0), ("ROD", 3.0), ("con", 4.0), ("plate", 5.0)):
        model.add_body(name, _body(mass))
    bodies, files, _ = flexible_bodies(model, tmp_path)
    names = [file.name for file in files.values()]
    assert len({name.casefold() for name in names}) == 5
    assert names[0] == "Rod.flexbody.h5"
    assert "con.flexbody.h5" not in names
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)
    assert [body.mass for body in bodies.values()] == [1.0, 2.0, 3.0, 4.0, 5.0]
