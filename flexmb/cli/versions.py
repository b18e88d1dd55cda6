"""Versions of flexmb and of what it stands on."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version

__all__ = ["PACKAGES", "flexmb_version", "package_version"]

PACKAGES = {
    "numpy": "arrays",
    "scipy": "sparse matrices and eigenvalues",
    "scikit-fem": "finite elements",
    "meshio": "mesh files",
    "numba": "compiled time loop",
    "h5py": "body and result files",
    "pydantic": "scenes",
    "pyvista": "pictures",
    "vtk": "pictures",
    "matplotlib": "plots",
    "typer": "command line",
    "rich": "command line",
    "platformdirs": "cache folder",
}


def flexmb_version() -> str:
    """The version of flexmb itself."""
    import flexmb

    return str(getattr(flexmb, "__version__", "of unknown version"))


def package_version(package: str) -> str | None:
    """The installed version of a package; None if it is missing."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None
