"""Editing of files of flexmb by tests: the checksum is right again afterwards."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from flexmb.untrusted import seal


@contextmanager
def edit_hdf5(path: Path) -> Iterator[h5py.File]:
    """The open file; at the end it is sealed as a whole file of this user."""
    with h5py.File(path, "r+") as file:
        yield file
    seal_again(path)


def seal_again(path: Path) -> None:
    """Make the checksum right for what the file holds now."""
    with path.open("r+b") as disk:
        line = seal(disk)
        disk.seek(0)
        disk.write(line)
