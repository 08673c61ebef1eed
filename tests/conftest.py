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
