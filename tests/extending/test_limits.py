"""A new kind of something touches few files of the package: its own and one registry line."""

from __future__ import annotations

from pathlib import Path

import pytest

from extending import LIMITS, Extension, apply, hunks, kind_of, patches


@pytest.mark.parametrize("name", patches())
def test_a_new_kind_names_few_files(name: str) -> None:
    files = {hunk.file for hunk in hunks(name)}
    assert all(file.startswith("flexmb/") for file in files), "the package, not its tests"
    assert len(files) <= LIMITS[kind_of(name)], sorted(files)


@pytest.mark.parametrize("name", patches())
def test_every_patch_applies_and_imports(name: str, tmp_path: Path) -> None:
    extension = Extension(name, tmp_path)
    where = extension.run("import flexmb.cli; print(flexmb.cli.__file__)")
    assert Path(where.strip()).is_relative_to(extension.folder)


def test_a_patch_that_does_not_fit_says_so(tmp_path: Path) -> None:
    extension = Extension("output_format", tmp_path)
    with pytest.raises(AssertionError, match=r"occur 0 times in flexmb/.*, renew the patch"):
        apply("output_format", extension.folder)
