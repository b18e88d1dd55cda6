"""Points from text files, and the sentences of files that hold something else."""

from __future__ import annotations

import numpy as np
import pytest

from flexmb.errors import SceneError
from flexmb.model import Model
from flexmb.model.functions.function import read_function
from flexmb.model.reading import ReadContext
from flexmb.units import unit_system

FIELDS = {"type": "table", "file": "motion.csv", "beyond": "hold"}


def read(tmp_path, text, system="SI", **fields):
    (tmp_path / "motion.csv").write_text(text, encoding="utf-8")
    names = ReadContext({}, unit_system(system), folder=tmp_path)
    return read_function({**FIELDS, **fields}, names, "m")


@pytest.mark.parametrize(
    ("text", "fields"),
    [
        ("0,0\n1,10\n2,30\n", {}),
        ("# measured\ntime,lift\n0,0\n\n1,10\n2,30\n", {}),
        ('"time";"load";"lift"\n0;7;0\n1;8;10\n2;9;30', {"columns": ["time", "lift"]}),
        ("7\t0\t0\n7\t10\t1\n7\t30\t2\n", {"columns": [3, 2]}),
        ("  0   0\n 1e0  1.0E1\n2 30\n", {}),
        ("0,0\n1000,1\n2000,3\n", {"units": ["ms", "cm"]}),
    ],
    ids=["bare", "header and comment", "by name", "by number", "blanks", "own units"],
)
def test_columns_are_read(tmp_path, text, fields):
    function = read(tmp_path, text, "mm-t-s", **fields)
    assert function.value(1.5)[0] == pytest.approx(0.02)
    assert function.source["points"] == [[0, 0], [1, 10], [2, 30]]  # and no file is needed any more
    assert "file" not in function.source and "columns" not in function.source


@pytest.mark.parametrize(
    ("text", "fields", "sentence"),
    [
        ("0,0\n1,x\n", {}, 'motion.csv, line 2: "x" is no finite number'),
        ("t,y\n0,0\n# a\n1,nan\n", {}, 'motion.csv, line 4: "nan" is no finite number'),
        ("0,0\n1,1\n1,2\n", {}, "motion.csv, line 3: times must increase, 1 does not lie after"),
        ("0,0\n1\n", {}, "motion.csv, line 2: there are 1 columns, line 1 has 2; decimals"),
        (
            "t,y\n0,0,5\n1,2\n",
            {},
            "motion.csv, line 2: there are 3 columns, line 1 has 2; decimals",
        ),
        ("t;y\n0;0,5\n1;2\n", {}, '"0,5" is no finite number; decimals are written with a point'),
        ("t,y\n0,0\n1,1\n", {"columns": ["t", "lift"]}, 'motion.csv has no column "lift"'),
        ("0,0\n1,1\n", {"columns": ["t", "y"]}, "its first line names none"),
        ("0,0\n1,1\n", {"columns": [0, 1]}, "a number from 1 on, given 0"),
        ("0,0\n1,1\n", {"columns": [1]}, "two columns, of t and of y"),
        ("0,0\n1,1\n", {"units": ["s", "deg"]}, '"deg" is no unit of this column, "m" is'),
        ("0,0\n1,1\n", {"units": ["sec", "m"]}, 'unknown unit "sec"'),
        ("", {}, "motion.csv holds no numbers"),
        ("0,0\n", {}, "two points or more are needed, given 1"),
        ("0,0\n1,1\n", {"file": "motions.csv"}, "there is no file"),
        ("0,0\n1,1\n", {"file": 3}, "the name of a file is expected"),
        ("0,0\n1,1\n", {"points": [[0, 0], [1, 1]]}, 'give either "points" or "file"'),
    ],
)
def test_mistakes_are_told_with_their_line(tmp_path, text, fields, sentence):
    with pytest.raises(SceneError) as caught:
        read(tmp_path, text, **fields)
    assert sentence in str(caught.value)


def test_paths_are_relative_to_the_scene(tmp_path):
    (tmp_path / "motion.csv").write_text("t,y\n0,0\n2,3\n")
    scene = {
        "bodies": {"b": {"mass": 1, "inertia": [1, 1, 1]}},
        "joints": {"j": {"type": "prismatic", "between": ["ground", "b"], "axis": "x"}},
        "drivers": {"d": {"joint": "j", "stroke": FIELDS}},
    }
    model = Model.from_scene_dict(scene, tmp_path)
    assert model.drivers["d"].function.value(1.0)[0] == 1.5
    (tmp_path / "motion.csv").unlink()
    again = Model.from_scene_dict(model.to_scene_dict(), tmp_path / "elsewhere")
    assert again.drivers["d"].function.value(1.0)[0] == 1.5
    python = Model(folder=tmp_path)
    python.add_body("b", mass=1, inertia=[1, 1, 1])
    with pytest.raises(SceneError, match=r"drivers\.d\.stroke.*there is no file"):
        python.add_driver("d", joint="j", stroke=FIELDS)
    assert np.isfinite(again.drivers["d"].function.value(9.0)).all()
