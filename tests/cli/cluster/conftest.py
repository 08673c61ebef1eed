"""A cluster within this process, which serves all tests that need no processes."""

import pytest

distributed = pytest.importorskip("distributed", reason="Dask is not installed; run python3 dev.py clusters")


def _local(workers: int):
    return distributed.LocalCluster(
        n_workers=workers, threads_per_worker=1, processes=False, dashboard_address=":0", silence_logs=50
    )


@pytest.fixture(scope="session")
def address():
    """The address of a scheduler with two workers of one thread each."""
    with _local(2) as local:
        yield local.scheduler_address


@pytest.fixture(scope="session")
def addresses(address):
    """Number of workers -> the address of their scheduler."""
    with _local(1) as one, _local(4) as four:
        yield {1: one.scheduler_address, 2: address, 4: four.scheduler_address}
