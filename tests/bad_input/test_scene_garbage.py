"""Scenes with parts replaced by garbage: either a model or a SceneError, never anything else."""

from __future__ import annotations

import contextlib
import copy
import random
import tomllib
from pathlib import Path

import pytest

from flexmb.errors import SceneError
from flexmb.model import Model
from flexmb.units import UNIT_SYSTEMS

CASES = Path(__file__).parents[2] / "cases"
SYSTEMS = (*UNIT_SYSTEMS, "mm", 3, None, [])
GARBAGE = (
    *(None, True, 0, -1, float("inf"), float("nan"), 10**400, "", "x", "t", "1/0", "a.b.c", "\0"),
    *("9 deg", " deg", "-", "placed", "none", ".x", "9" * 5000, [], {}, [1], [1, 2, 3]),
    *(["z", {}, []], [[1, 2, 3]] * 3, [1e200] * 3, [[1e200] * 3] * 3, {"type": "box"}),
    *("1 mm", "2 t", "3 rad/s", "rpm", "earth -y", "mm-kg-ms", "scene", "1e308 km"),
    *({"euler": "xyz", "angles": [1, 2, 3]}, {"x_along": "z", "y_towards": "-z"}),
    *({"origin": {"velocity": [1, 2, 3]}}, {"pin": {"angular_velocity": ["1 rpm", 0, 0]}}),
    *({"type": [1]}, {1: 2}, {"": {}}, {"axis": "z", "angle": "9 deg"}, {"a": {"node": 3}}),
)


def _places(data, path=()):
    items = data.items() if isinstance(data, dict) else enumerate(data)
    for key, value in items:
        yield (*path, key)
        if isinstance(value, dict | list):
            yield from _places(value, (*path, key))


_SEEDS = [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2, 3))]


@pytest.mark.seconds
@pytest.mark.parametrize("seed", _SEEDS)
def test_garbage_is_a_scene_error_or_nothing(seed):
    rng = random.Random(seed)
    scenes = [tomllib.loads(path.read_text()) for path in sorted(CASES.glob("*/scene.toml"))]
    for _ in range(150):
        scene = copy.deepcopy(rng.choice(scenes)) | {"units": rng.choice(SYSTEMS)}
        for _ in range(rng.randint(1, 3)):
            *path, key = rng.choice(list(_places(scene)))
            table = scene
            for part in path:
                table = table[part]
            table[key] = copy.deepcopy(rng.choice(GARBAGE))
        with contextlib.suppress(SceneError):
            Model.from_scene_dict(scene, CASES / "slider_crank")
