"""The fixture ``record`` of the catalogue's tests, and the file its figures go to at the end."""

import os

import pytest

from devtools.catalogue import FIGURES_VARIABLE
from tests.stability.catalogue import WIDTHS, Catalogue, ids_in
from tests.ways import RARE_TYPES

CATALOGUE = Catalogue()


@pytest.fixture
def record(request):
    """``record(case, claim, measured, bound, width="float32", why="", looser="")``: see ``Catalogue.record``.

    The case's id must be in the test's name, and a test that asks for this must record something.
    """
    named = ids_in(request.node.name)
    assert named, f"{request.node.name} names no case of the catalogue"
    recorded = []

    def checked(case, *args, **kwargs):
        assert case in named, f"{case} is not in the name of {request.node.name}"
        recorded.append(case)
        CATALOGUE.record(case, *args, **kwargs)

    yield checked
    failed = getattr(request.node, "stability_failed", False)
    assert recorded or failed, f"{request.node.name} recorded nothing"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    report = yield
    if report.when == "call" and not report.passed:
        item.stability_failed = True
    return report


def pytest_sessionfinish():
    if os.environ.get(FIGURES_VARIABLE):
        CATALOGUE.save(os.environ[FIGURES_VARIABLE])


@pytest.hookimpl(tryfirst=True)  # before pytest leaves tests out by their marks
def pytest_collection_modifyitems(items):
    """Leave to the deep tests what takes a kernel that is compiled for a few tests: sums in double precision of
    opacities, and of volumes that are classified after interpolation; normals of two of the stored types.  Numpy, too,
    takes too long for the sheets of sums in double precision, but for the counts of test_A1 and the small pictures of
    test_A13."""
    for item in items:
        given = item.callspec.params if hasattr(item, "callspec") else {}
        name, by_numpy = item.originalname, given.get("way") == "numpy"
        in_double = given.get("width") == "float64" or name == "test_A13_single_and_double_width"
        other = {"opacity", "post"} & {given.get(word) for word in ("model", "kind", "classification")}
        other |= {"post"} if name.startswith("test_K5_") else set()
        few = name.startswith(("test_A1_the_plan", "test_A13_single"))
        if in_double and ("opacity" in other or (not few if by_numpy else other)):
            item.add_marker("deep")
        rare = given.get("way") == "numba" and given.get("dtype") in RARE_TYPES
        if rare and name.startswith(("test_V8_", "test_V12_")):
            item.add_marker("deep")


@pytest.fixture(params=WIDTHS)
def width(request, monkeypatch):
    """The arithmetic in which a picture's color and transmittance are summed: its name, for ``record``."""
    if request.param == "float64":
        monkeypatch.setattr("rle_splat.splat.pixel_block.MOST_SHEETS_IN_SINGLE", 0)
    return request.param
