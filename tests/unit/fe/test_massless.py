"""Motions without mass: modes there are, told how many, and a body that cannot be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from femeshes import line
from scipy.sparse import csr_array, diags_array

from flexmb.errors import ReductionError
from flexmb.fe import (  # fmt: skip
    Mesh,
    assemble,
    craig_bampton,
    make_interfaces,
    orthonormalise,
    part,
    rectangle,
    reduce,
    resolve,
)
from flexmb.fe.reduction.fixed_interface import mass_solve


def bar(massless):
    """A beam of eight elements with the mass of displacements alone at all nodes but some."""
    fe = assemble(line(8), resolve("steel"), {"all": rectangle(0.02, 0.03)})
    mass = np.zeros(fe.numbering.n)
    mass[fe.numbering.table[:, :3]] = 1.0
    mass[fe.numbering.table[massless]] = 0.0
    return replace(fe, M=csr_array(diags_array(mass)))


def test_lumped_masses_at_the_middle_of_a_clamped_beam():
    """Massless bending: three lumps at nodes 3, 4, 5; the others follow without inertia. Axially a
    chain of springs k = EA/h and three masses between walls, three springs at each end."""
    fe = bar([0, 1, 2, 6, 7, 8])
    ends = make_interfaces(fe, {"root": "root", "tip": "tip"})
    found = craig_bampton(fe, ends, 9)
    E, A, h = resolve("steel").E, 0.02 * 0.03, 1 / 8
    k = E * A / h
    K = k * np.array([[4 / 3, -1, 0], [-1, 2, -1], [0, -1, 4 / 3]])
    got = np.diag(found.K)[12:]
    for wanted in np.linalg.eigvalsh(K):
        assert np.abs(got / wanted - 1).min() < 1e-8
    with pytest.raises(ReductionError, match="10 requested, but .* only 9 fixed-interface"):
        craig_bampton(fe, ends, 10)
    with pytest.raises(ReductionError, match="a motion of the reduced body has no mass"):
        orthonormalise(fe, craig_bampton(fe, ends, 3))


def test_solving_with_a_mass_matrix():
    """A consistent one, and one with empty rows: zero there."""
    fe = assemble(line(8), resolve("steel"), {"all": rectangle(0.02, 0.03)})
    B = np.random.default_rng(0).normal(size=(fe.numbering.n, 3))
    np.testing.assert_allclose(fe.M @ mass_solve(fe.M, B), B, atol=1e-10)
    fe = bar([0, 1])
    X = mass_solve(fe.M, fe.M @ B)
    np.testing.assert_allclose(X, np.where(fe.M.diagonal()[:, None] > 0, B, 0), atol=1e-12)


@pytest.mark.parametrize("solve", [reduce, part])
def test_a_free_beam_whose_second_half_has_hardly_any_mass_vibrates_like_the_first(solve):
    """Free-free: 22.3733, 61.6728, 120.903 sqrt(EI/m)/L^2 in both planes (Blevins, table 8-1)."""
    mesh = line(16)
    steel, light = (resolve({"E": 2e11, "nu": 0.3, "density": rho}) for rho in (8000.0, 8e-9))
    halves = {"heavy": {"line": np.arange(8)}, "light": {"line": np.arange(8, 16)}}
    mesh = Mesh(mesh.points, mesh.blocks, {}, halves)
    sections = {
        name: rectangle(2e-3, 1e-3, shear=False, material=material)
        for name, material in (("heavy", steel), ("light", light))
    }
    words = {"modes": 5} if solve is reduce else {"frequencies": 5}
    frequencies = solve(mesh, material=steel, sections=sections, **words).frequencies
    waves = np.array([22.3733, 61.6728, 120.903]) / (2 * np.pi * 0.5**2)
    bending = np.sort(np.outer([1e-3, 2e-3], waves).ravel() * np.sqrt(2e11 / 12 / 8000.0))[:5]
    assert frequencies == pytest.approx(bending, rel=3e-3)
