"""An output format by one file and one registry line: MATLAB's, also in the command line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import slidercrank
from scipy.io import loadmat

from extending import Extension
from flexmb.results import Result

EXPORT = """
import sys
import flexmb
from flexmb.cli import main
result = flexmb.load_result(sys.argv[1])
result.export(sys.argv[2], ["slider.x", "energy.kinetic"])
sys.argv[1:] = ["export", sys.argv[1], "--output", sys.argv[3]]
main()
"""


def test_a_new_output_format_writes_what_the_result_holds(tmp_path: Path) -> None:
    extension = Extension("output_format", tmp_path)
    result = Result(slidercrank.make(tmp_path))
    output = extension.run(EXPORT, result.path, tmp_path / "a.mat", tmp_path / "all.mat")
    assert "all.mat" in output
    table = loadmat(tmp_path / "a.mat", squeeze_me=True, appendmat=False)
    np.testing.assert_array_equal(table["time"], result.time)
    np.testing.assert_array_equal(table["slider_x"], result["slider.x"])
    np.testing.assert_array_equal(table["energy_kinetic"], result["energy.kinetic"])
    assert table["units"]["slider_x"] == "m"
    every = loadmat(tmp_path / "all.mat", squeeze_me=True, appendmat=False)
    assert {name.replace(".", "_") for name in result.channels()} < set(every)
