"""The list of mutants fits the sources: each stands in one place, and its tests are there."""

from __future__ import annotations

from tests.mutants import ROOT, all_mutants, relevant_tests

MUTANTS = all_mutants()


def test_each_changes_one_place() -> None:
    problems = []
    for mutant in MUTANTS:
        try:
            mutant.changed()
        except ValueError as error:
            problems.append(str(error))
    assert not problems


def test_they_are_many_have_one_name_each_and_few_survive() -> None:
    names = [mutant.name for mutant in MUTANTS]
    assert len(names) == len(set(names)) >= 150
    assert sum(bool(mutant.survives) for mutant in MUTANTS) <= 0.05 * len(names)


def test_their_tests_are_there() -> None:
    paths = {path.split("::")[0] for mutant in MUTANTS for path in relevant_tests(mutant)}
    assert [path for path in sorted(paths) if not (ROOT / "tests" / path).exists()] == []
