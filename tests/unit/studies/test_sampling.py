"""The settings of a sweep: distributions by their closed forms, samples by what defines them."""

from __future__ import annotations

import signal
from contextlib import suppress

import numpy as np
import pytest
from scipy import stats

from flexmb.errors import SceneError
from flexmb.model.reading import ReadContext
from flexmb.model.scenes.sweep import read_distribution, read_question
from flexmb.studies.sweeps.sampling import deviation_of, make_design, values_at

NAMES = ReadContext({"k": 100.0, "r": 0.15})


@pytest.mark.parametrize(
    ("text", "exact"),
    [
        ("uniform(-1, 3)", stats.uniform(-1, 4)),
        ("0.9*k..1.1*k", stats.uniform(90, 20)),
        ("log-uniform(1e-3, 1e3)", stats.loguniform(1e-3, 1e3)),
        ("normal(r, 0.01)", stats.norm(0.15, 0.01)),
        ("normal(5, 2, 4, 9)", stats.truncnorm(-0.5, 2.0, 5, 2)),
        ("triangular(1, 2, 4)", stats.triang(1 / 3, 1, 3)),
        ("triangular(1, 1, 4)", stats.triang(0.0, 1, 3)),
        ("triangular(1, 4, 4)", stats.triang(1.0, 1, 3)),
    ],
)
def test_values_are_those_of_the_inverse_distribution(text: str, exact) -> None:
    u = np.array([0.001, 0.1, 0.3, 0.5, 0.77, 0.999])
    one = read_distribution(text, NAMES)
    np.testing.assert_allclose(values_at(one, u), exact.ppf(u), rtol=1e-11)
    np.testing.assert_allclose(deviation_of(one), exact.std(), rtol=2e-3)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("uniform(3, 3)", "the range is empty: 3 is not below 3"),
        ("5..1", "the range is empty: 5 is not below 1"),
        ("unifrom(1, 2)", 'unknown distribution "unifrom"; nearest: uniform'),
        ("log-uniform(0, 1)", "the ends must be positive"),
        ("normal(1, 0)", "the deviation must be positive, is 0"),
        ("normal(1, 2, 3)", "normal(mean, deviation) is expected"),
        ("normal(1, 2, 3, 4)", "the limits must be below and above the mean"),
        ("triangular(0, 5, 1)", "the mode 5 must lie between 0 and 1"),
        ("0..1:one", 'needs after ":" a number of values from 2'),
        ("..5", "a range has two ends: low..high"),
        ("", "no values are given"),
        ("q..1", "unknown"),
    ],
)
def test_what_is_wrong_with_a_distribution_is_said(text: str, what: str) -> None:
    with pytest.raises(SceneError) as error:
        read_distribution(text, NAMES)
    assert what in str(error.value)


def test_paths_and_names_are_choices() -> None:
    assert read_distribution("a.msh, ../b.msh", NAMES).choices == ("a.msh", "../b.msh")
    assert read_distribution(["steel", 3], NAMES).choices == ("steel", 3)
    assert read_distribution("10 mm..20 mm:3", NAMES).numbers == (0.01, 0.02)


@pytest.mark.parametrize(
    ("text", "relation"),
    [
        ("a.x:max<=5 kN", "<="),
        ("a:rms > 2", ">="),
        ("minimise a.x:min", "minimise"),
        ("a:final == 1", "="),
    ],
)
def test_questions_are_read(text: str, relation: str) -> None:
    assert read_question(text).relation == relation
    with pytest.raises(SceneError, match="is no question"):
        read_question("how long")


def design(method: str, samples: int = 64, seed: int = 3, **knobs: str):
    return make_design(
        {k: read_distribution(v, NAMES) for k, v in knobs.items()}, method, samples, seed
    )


def test_a_grid_has_all_combinations() -> None:
    rows = design("auto", a="0..1:3", b="x,y").values()
    assert [tuple(row.values()) for row in rows] == [
        (0.0, "x"), (0.0, "y"), (0.5, "x"), (0.5, "y"), (1.0, "x"), (1.0, "y"),
    ]  # fmt: skip


def test_latin_hypercubes_and_sobol_samples_fill_every_slice_once() -> None:
    for method in ("latin-hypercube", "sobol"):
        points = design(method, a="0..1", b="0..1", c="0..1").points
        slices = np.sort((points * 64).astype(int), axis=0)
        assert (slices == np.arange(64)[:, None]).all()
    again = design("sobol", a="0..1", b="0..1", c="0..1")
    assert (again.points == design("sobol", a="0..1", b="0..1", c="0..1").points).all()
    assert (again.points != design("sobol", seed=4, a="0..1", b="0..1", c="0..1").points).any()


def test_a_number_that_is_no_power_of_two_is_rounded_up_and_said() -> None:
    one = design("sobol", samples=100, a="0..1")
    assert len(one.points) == 128
    assert one.notes == ("samples: 100 is no power of two, 128 are taken",)


def test_a_saltelli_scheme_exchanges_one_column_at_a_time() -> None:
    blocks = design("saltelli", samples=8, a="0..1", b="0..1").points.reshape(8, 4, 2)
    A, B = blocks[:, 0], blocks[:, 1]
    assert not np.isclose(A, B).any()
    np.testing.assert_array_equal(blocks[:, 2], np.stack([B[:, 0], A[:, 1]], axis=1))
    np.testing.assert_array_equal(blocks[:, 3], np.stack([A[:, 0], B[:, 1]], axis=1))


@pytest.mark.parametrize(
    ("method", "knobs", "what"),
    [
        ("grid", {"a": "normal(1, 2)"}, 'a grid needs a number of values: "normal(1, 2):5"'),
        ("sobol", {"a": "0..1:5"}, ":5 is for a grid"),
        ("derivatives", {"a": "x,y"}, "has no derivative"),
        ("grid", {k: "0..1:1000" for k in "abc"}, "1000000000 runs; 1000000 are the most"),
        ("saltelli", {"a": "0..1"}, "runs; 1000000 are the most"),
    ],
)
def test_knobs_that_a_method_cannot_take(method: str, knobs: dict[str, str], what: str) -> None:
    with pytest.raises(SceneError) as error:
        design(method, samples=400_000, **knobs)
    assert what in str(error.value)


def test_derivatives_step_by_a_twentieth_of_the_probability() -> None:
    values = [one["a"] for one in design("derivatives", a="uniform(10, 30)").values()]
    assert values == pytest.approx([20.0, 18.0, 19.0, 21.0, 22.0])


def test_an_interruption_that_scipy_swallows_stops_the_sweep(monkeypatch) -> None:
    """It came while the direction numbers were read: all samples were the same, without a word."""

    class Sobol(stats.qmc.Sobol):
        def __init__(self, *words, **options):
            with suppress(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
            super().__init__(*words, **options)

    monkeypatch.setattr(stats.qmc, "Sobol", Sobol)
    usual = signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in the background
    try:
        with pytest.raises(KeyboardInterrupt):
            make_design({"a": read_distribution("uniform(0, 1)", NAMES)}, "sobol", 8, 1)
    finally:
        signal.signal(signal.SIGINT, usual)
