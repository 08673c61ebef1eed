"""Pictures and frames on a Dask cluster: the client, which hands out tasks and writes what comes back.

A picture is split into tiles, which are crops with the bits of the whole picture.  Each tile may be cut into sections,
which are composited in pairs of neighbors.  So the picture does not depend on how many workers there are, nor on which
of them makes a part.  Workers read the volume by its path; what goes over the network is options on the way there,
finished pixels on the way back, and the pixels of sections between workers.  Dask gives the tasks of a lost worker to
others.
"""

import logging
import math
import os
import signal
from argparse import Namespace
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from time import perf_counter

from ..runtime.outputs import write_report
from ..runtime.whole_files import whole_files
from ..scene import RleSplatError
from .cluster_worker import Command, cover, finish_tile, forget, list_jobs, make_frame, make_section, make_tile
from .dask_option import LOCAL
from .made import delete_abandoned, find_scene_hash, mark_of, outputs_of, report_kept, source_hash, write_mark
from .rows import row_writer_for

SECONDS = 5  # for an answer from the scheduler
WORKER_SECONDS = 30  # for the first worker
TILES_EACH = 4  # tiles for each thread of the workers, so that all end at about the same time
SMALLEST, LARGEST, STEP = 64, 1024, 32  # pixels: sides of tiles that are chosen here
# Options that name files which workers read, maybe in other folders; those of Checked are read here.
PATHS = ("volume", "transfer_function", "lights", "camera", "volume_matrix", "clip", "mist", "labels")


class Cluster:
    """A Dask cluster whose workers can render the job of a command; made by ``connect``.

    Attributes
    ----------
    client : distributed.Client
    threads : int
        Tasks that the workers run at the same time.
    """

    def __init__(self, client):
        self.client = client

    @property
    def threads(self) -> int:
        return max(sum(self.client.nthreads().values()), 1)

    def submit(self, job: Command, function, *task, inputs=(), section: tuple[int, int] | None = None):
        """Hand out a task; return its future.

        Parameters
        ----------
        function : callable
            ``function(job, *task, *inputs)``.
        inputs : sequence of futures
            Results of other tasks, which workers hand to one another.
        section : (int, int) or None
            Number of the section that it reads, and of how many: tasks of a section go to the same worker where that is
            possible, and so do neighbors where there are fewer workers.
        """
        from distributed.protocol.pickle import dumps

        # The scheduler unpacks what it hands on, and need not have this package: tasks are bytes to it, and a function
        # within a function is sent as it is.
        def run_packed(packed: bytes, *inputs):
            from distributed.protocol.pickle import loads

            function, job, task = loads(packed)
            return function(job, *task, *inputs)

        where = {}
        if section is not None:
            number, count = section
            workers = sorted(self.client.nthreads())
            own = workers[number * len(workers) // count :][:1]  # none while all are lost
            where = {"workers": own, "allow_other_workers": True} if own else {}
        return self.client.submit(run_packed, dumps((function, job, task)), *inputs, pure=False, **where)

    def results(self, job: Command, tasks, count: int, line, what: str, parts: int = 1):
        """Yield (number of the task, Made) as tasks end.

        Parameters
        ----------
        tasks : iterable of callables
            ``task(submit)`` hands out a task, and those that it needs, and returns its future; ``submit``: the method,
            but for the job.
        count : int
            Their number.
        line : ProgressLine
        what : str
            A task, in words for a person.
        parts : int
            About how many others a task needs.
        """
        from distributed import as_completed

        # Few at a time, so that results do not pile up here; the order is that of the tasks but for the last few.
        waiting = iter(enumerate(tasks))
        futures = {}

        def submit():
            for number, task in waiting:
                future = task(partial(self.submit, job))
                futures[future] = number
                return [future]
            return []

        with _watch_connection():
            first = [future for _ in range(max(3 * self.threads // parts, 2)) for future in submit()]
            done, ended = 0, as_completed(first)
            for future in ended:
                made = self._result(future)
                done += 1
                line.show(done / count, f"{what} {done} of {count}, on {len(self.client.nthreads())} workers")
                number = futures.pop(future)
                future.release()
                ended.update(submit())
                yield number, made

    def forget(self, job: Command) -> None:
        """Let the workers drop what they kept for a job; without a connection there is nothing to be done."""
        with suppress(OSError):
            self.client.run(forget, [job.key], on_error="ignore")

    def forget_killed(self) -> None:
        """Let the workers drop what they kept for commands that were killed: the scheduler knows who is connected."""

        def list_clients(dask_scheduler):
            return set(dask_scheduler.clients)

        kept = set().union(*self.client.run(list_jobs, on_error="ignore").values())
        if killed := kept and kept - self.client.run_on_scheduler(list_clients):
            self.client.run(forget, killed, on_error="ignore")

    def _result(self, future):
        """The result of a task; what went wrong on a worker is raised here."""
        from distributed.scheduler import KilledWorker

        try:
            return future.result()
        except KilledWorker:
            raise RleSplatError(
                "Several workers were lost over the same part of the picture; they may have too little memory for the "
                "volume: give them more, or fewer threads."
            ) from None
        except OSError as problem:
            if problem.errno is None:  # of the connection
                raise
            raise RleSplatError(f"A worker reported an error: {problem.strerror}.") from None


@contextmanager
def _watch_connection():
    """Context manager: a lost connection to the scheduler becomes a RleSplatError."""
    from distributed import CancelledError

    try:
        yield
    except (CancelledError, OSError):
        raise RleSplatError("The connection to the Dask scheduler was lost; run the command again.") from None


@contextmanager
def connect(args, job_inputs, line):
    """Context manager: a Cluster whose workers have this version of the package and see the input files.

    Parameters
    ----------
    args : argparse.Namespace
        With ``dask`` and ``workers``.
    job_inputs : list of str
        Absolute paths of files that the workers read.
    line : ProgressLine

    Raises
    ------
    RleSplatError
        If nobody answers, there is no worker, or a worker cannot do the job.
    """
    from distributed import Client

    with ExitStack() as stack:
        stack.enter_context(_silent())
        line.show(0.0, "connecting to the cluster")
        address = stack.enter_context(_local_cluster(args)) if args.dask == LOCAL else args.dask
        try:
            client = stack.enter_context(Client(address, timeout=SECONDS, set_as_default=False))
        except (OSError, ValueError) as problem:
            raise RleSplatError(
                f"No Dask scheduler answers at {args.dask} within {SECONDS} seconds; start one there, or give the "
                "address that it prints, such as tcp://host:8786."
            ) from problem
        try:
            client.wait_for_workers(1, timeout=WORKER_SECONDS)
        except TimeoutError:
            raise RleSplatError(
                f"The Dask scheduler at {args.dask} has no workers after {WORKER_SECONDS} seconds; start some."
            ) from None
        stack.enter_context(client.as_current())  # for as_completed
        _check_workers(client, job_inputs)
        line.clear()
        print(f"Cluster of {len(client.nthreads())} workers; dashboard: {client.dashboard_link}", flush=True)
        cluster = Cluster(client)
        cluster.forget_killed()
        yield cluster


@contextmanager
def _silent():
    """Context manager: what goes wrong becomes one error here, and not messages of Dask's loggers."""
    names = [name for name in logging.root.manager.loggerDict if name.startswith(("distributed", "tornado"))]
    levels = {name: logging.getLogger(name).level for name in names}
    try:
        for name in names:
            logging.getLogger(name).setLevel(logging.CRITICAL)
        yield
    finally:
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)


def worker_count(args) -> int:
    """The processes of a cluster on this machine."""
    return args.workers or max(2, (os.cpu_count() or 1) // 4)


@contextmanager
def _local_cluster(args):
    """Context manager: a cluster of processes of this machine."""
    from distributed import LocalCluster

    with _ignore_interrupts():
        local = LocalCluster(
            n_workers=worker_count(args), threads_per_worker=1, processes=True, silence_logs=logging.CRITICAL,
            memory_limit=0, dashboard_address=":0",
        )  # fmt: skip
    try:
        yield local
    finally:
        with _ignore_interrupts():
            local.close()


@contextmanager
def _ignore_interrupts():
    """Context manager: Ctrl+C waits for the end of the block, and processes that begin there never hear of it.

    A terminal sends it to all of them, and a worker would tell of it by a traceback.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # it unblocks the signal when it begins
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])  # which threads and processes inherit
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _check_workers(client, paths) -> None:
    """RleSplatError where a worker has another version of the package, or does not see a file."""

    def facts(names):
        import os

        try:
            from .made import source_hash
        except ImportError:
            return None, []
        return source_hash(), [name for name in names if not os.access(name, os.R_OK)]

    for worker, found in client.run(facts, paths, on_error="return").items():
        if isinstance(found, Exception):
            raise RleSplatError(f"The worker {worker} does not work ({type(found).__name__}); start it again.")
        if found[0] is None:
            raise RleSplatError(f"The worker {worker} does not have the package rle-splat; install it there.")
        if found[0] != source_hash():
            raise RleSplatError(
                f"The worker {worker} has another version of RLE Splat; install the same version on all workers."
            )
        if found[1]:
            raise RleSplatError(
                f"The worker {worker} cannot read {found[1][0]}; put the file where all workers find it under this "
                "path."
            )


def _absolute(args) -> Namespace:
    """The options with absolute paths, for workers that run in other folders."""
    own = Namespace(**vars(args))
    for name in PATHS:
        if isinstance(getattr(own, name), str):
            setattr(own, name, os.path.abspath(getattr(own, name)))
    own.channel = [os.path.abspath(path) for path in own.channel]
    own.run = None  # a function, which is of no use there
    return own


def _paths_of(args) -> list[str]:
    """The paths that the workers of a command read."""
    own = _absolute(args)
    return [path for path in (*(getattr(own, name) for name in PATHS), *own.channel) if path is not None]


def _job_of(args, checked, cluster: Cluster) -> Command:
    """The Command of a command, with the key of its client."""
    if args.threads == 0 and args.dask == LOCAL:
        threads = max((os.cpu_count() or 1) // worker_count(args), 1)
        checked = replace(checked, quality=replace(checked.quality, threads=threads))
    return Command(cluster.client.id, _absolute(args), checked)


def picture_on_cluster(args, checked, line, start: float, report_of) -> dict:
    """Render a picture on a cluster and write it; return its report.

    Parameters
    ----------
    args : argparse.Namespace
    checked : Checked
    line : ProgressLine
    start : float
        When the command was begun, by ``perf_counter``.
    report_of : callable
        Makes the command's report: ``report_of(args, prepared, rendered, write_ms, start)``.
    """
    delete_abandoned(args.output)
    with connect(args, _paths_of(args), line) as cluster:
        job = _job_of(args, checked, cluster)
        region = checked.crop or (0, 0, *args.size)
        side = args.tile or _side(region, -(-cluster.threads // (args.slabs or 1)))
        with whole_files([*args.output, *([args.json] if args.json else [])]) as parts:
            try:
                prepared, rendered = _put_together(args, job, cluster, region, side, parts, line)
            finally:
                cluster.forget(job)
            report = report_of(args, prepared, rendered, 0.0, start)
            report["workers"] = len(cluster.client.nthreads())
            report["slabs"] = args.slabs
            if args.json:
                write_report(parts[-1], report)
    return report


def _put_together(args, job: Command, cluster: Cluster, region, side: int, parts, line):
    """Write the tiles of a picture to ``parts``; return a Prepared without its scene, and the renderer's report."""
    from ..pipeline.tiles import Strip, Total, tiles_of

    tiles = tiles_of(region, side)
    across = -(-(region[2] - region[0]) // side)
    total, strips, left, first, prepared = Total(job.checked.crop, args.size, side), {}, {}, 0, None
    with ExitStack() as stack:
        files = [
            stack.enter_context(
                row_writer_for(path)(
                    part, region[2] - region[0], region[3] - region[1], args.background, args.slabs is None
                )
            )
            for path, part in zip(args.output, parts, strict=False)
        ]
        tasks = (_tile_task(tile, args.slabs) for tile in tiles)
        for number, made in cluster.results(job, tasks, len(tiles), line, "tile", args.slabs or 1):
            prepared = made.prepared
            row = number // across
            if row not in strips:
                strips[row], left[row] = Strip(region, tiles[number]), across
            strips[row].put(tiles[number], made.rendering.rgba, made.rendering.depth)
            total.add(made.rendering)
            left[row] -= 1
            while left.get(first) == 0:  # rows go into the files from the top on
                strip = strips.pop(first)
                for file in files:
                    file.write(strip.rgba, strip.depth)
                first += 1
    return prepared, total.report()


def _tile_task(tile, sections: int | None):
    """The task of a tile, as ``Cluster.results`` takes it; ``sections``: their number, or None for a tile at once."""
    if sections is None:
        return lambda submit: submit(make_tile, tile)

    def hand_out(submit):
        parts = [submit(make_section, tile, number, sections, section=(number, sections)) for number in range(sections)]
        while len(parts) > 1:  # a tree of neighbors, the same for any number of workers
            pairs = zip(parts[::2], parts[1::2])
            parts = [submit(cover, inputs=pair) for pair in pairs] + parts[len(parts) // 2 * 2 :]
        return submit(finish_tile, tile, inputs=parts)

    return hand_out


def _frame_task(args, own: Namespace):
    """The task of a frame, as ``Cluster.results`` takes it."""
    made = None if args.again else find_scene_hash(outputs_of(own))
    return lambda submit: submit(make_frame, _absolute(own), made)


def _side(region, threads: int) -> int:
    """The side of tiles that gives each thread a few."""
    pixels = (region[2] - region[0]) * (region[3] - region[1])
    side = math.ceil(math.sqrt(pixels / (TILES_EACH * threads)) / STEP) * STEP
    return min(max(side, SMALLEST), LARGEST)


def frames_on_cluster(args, frames, checked, line, write) -> list[dict]:
    """Render frames on a cluster, one a task, and write them; return their reports.

    Parameters
    ----------
    args : argparse.Namespace
    frames : sequence of argparse.Namespace
        The options of each frame.
    checked : Checked
    line : ProgressLine
    write : callable
        Writes a Rendering and makes its report: ``write(own, made, parts, start)``.
    """
    if args.like is None and args.turn is None and args.camera_path is None:
        args = Namespace(**{**vars(args), "like": frames[0].number})  # tasks come in any order
    tasks, reports = (_frame_task(args, own) for own in frames), {}
    with connect(args, _paths_of(args), line) as cluster:
        job = _job_of(args, checked, cluster)
        try:
            for number, made in cluster.results(job, tasks, len(frames), line, "frame"):
                own = frames[number]
                reports[number] = report_kept(own) if made.rendering is None else _write(own, made, write)
        finally:
            cluster.forget(job)
    return [reports[number] for number in sorted(reports)]


def _write(own, made, write) -> dict:
    """Write a frame and its hidden files; return its report."""
    outputs, start = outputs_of(own), perf_counter()
    delete_abandoned(outputs)
    with whole_files([*outputs, *map(mark_of, outputs)]) as parts:
        report = write(own, made, parts, start)
        for mark, part in zip(parts[len(outputs) :], parts, strict=False):
            write_mark(mark, made.scene_hash, part)
    return report
