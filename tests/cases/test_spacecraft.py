"""The spacecraft's momentum, summed over its bodies by the integrals of their files, stays zero."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexmb
from flexmb.flexbody import load

SCENE = Path(__file__).parents[2] / "cases" / "spacecraft_panels" / "scene.toml"
RIGID = {
    "bus": (300.0, 300 / 12 * np.array([1.0 + 1.2**2, 1.0 + 1.2**2, 2.0])),
    "wheel": (40.0, 40 * np.array([(3 * 0.09 + 0.01) / 12, 0.09 / 2, (3 * 0.09 + 0.01) / 12])),
}


def momentum(result, layout, files):
    """(n, 6) of one body: momentum, and moment of momentum about the global origin."""
    q = result.q[:, layout.iq : layout.iq + 7 + layout.m]
    v = result.v[:, layout.iv : layout.iv + 6 + layout.m]
    A = Rotation.from_quat(q[:, [4, 5, 6, 3]]).as_matrix()
    r, speed, w = q[:, :3], v[:, :3], v[:, 3:6]
    eta, rate = q[:, 7:], v[:, 6:]
    if layout.name in RIGID:
        mass, J = RIGID[layout.name]
        first, carried, moment = np.zeros_like(r), np.zeros_like(r), J * w
    else:
        body = files[layout.name]
        mass, P, M = body.mass, body.P, body.Mab
        first = body.S1 + eta @ body.p.T
        carried = rate @ body.p.T
        half = np.einsum("abm,nm->nab", P, eta)
        S = body.S0 + half + half.transpose(0, 2, 1) + np.einsum("ni,abij,nj->nab", eta, M, eta)
        J = np.trace(S, axis1=1, axis2=2)[:, None, None] * np.eye(3) - S
        # s x u': rows of the second moments between position and rate
        G = np.einsum("abm,nm->nab", P, rate) + np.einsum("ni,abij,nj->nab", eta, M, rate)
        own = np.stack([G[:, b, c] - G[:, c, b] for b, c in ((1, 2), (2, 0), (0, 1))], axis=1)
        moment = np.einsum("nab,nb->na", J, w) + own
    linear = mass * speed + np.einsum("nab,nb->na", A, np.cross(w, first) + carried)
    inner = np.cross(first, np.einsum("nba,nb->na", A, speed)) + moment
    return np.hstack([linear, np.cross(r, linear) + np.einsum("nab,nb->na", A, inner)])


@pytest.mark.seconds
def test_momentum_is_kept(tmp_path):
    model = flexmb.load_scene(SCENE)
    model.checks.clear()  # they end later
    result = flexmb.simulate(model, output=tmp_path, duration=1.5, outputs=15, accuracy=1e-8,
                             verify=False)  # fmt: skip
    files = {name: load(path) for name, path in result.flexbodies.items()}
    parts = [momentum(result, layout, files) for layout in result.layout.bodies]
    total = sum(parts)
    wheel = np.abs(parts[[b.name for b in result.layout.bodies].index("wheel")]).max(axis=0)
    assert wheel[4] > 10.0  # N m s
    assert np.abs(total).max() < 1e-10 * wheel[4], np.abs(total).max(axis=0) / wheel[4]
