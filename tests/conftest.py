"""The root folder has an __init__.py that is Blender's entry point; pytest must not take it for a package."""

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


class RootIsAFolder:
    """Collect the root as a plain folder: as a package, its __init__.py would be imported, and that wants bpy."""

    @pytest.hookimpl(tryfirst=True)
    def pytest_collect_directory(self, path, parent):
        return pytest.Dir.from_parent(parent, path=path) if path == ROOT else None


def pytest_configure(config):
    config.pluginmanager.register(RootIsAFolder())


@pytest.fixture(params=("numba", "numpy"))
def way(request):
    """Let the kernels do a test's work, then the numpy reference; its value is the name."""
    from rle_splat.runtime.jit import compiled, use_reference

    if request.param == "numba" and not compiled():
        pytest.skip("numba cannot be loaded")
    with use_reference(request.param == "numpy"):
        yield request.param


@pytest.fixture(scope="module")
def by_numpy():
    """Let the numpy reference do the work of a whole module, so that it compiles no kernels; for ``pytestmark``."""
    from rle_splat.runtime.jit import use_reference

    with use_reference():
        yield
