"""The MDAnalysis way: mdtopo as an ``AnalysisBase``, on all of its backends.

Frames are split among workers in contiguous groups. Each worker measures the steps within its group; the steps at the
seams, which belong to no group, are measured in the end from two frames that are read again. A bond that breaks changes
what later groups should have measured; from the first group that this concerns on, frames are then measured again in
order. So every backend gives the same bits.
"""

import pickle
import sys
from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from MDAnalysis.analysis.backends import BackendBase
from MDAnalysis.analysis.base import AnalysisBase
from MDAnalysis.analysis.results import Results, ResultsGroup

from mdtopo.alerts import AlertStream
from mdtopo.bonds import reference_lengths
from mdtopo.curverows import refuse_long_strands
from mdtopo.errors import ClusterError
from mdtopo.measure import measure_block
from mdtopo.notebook import plot_steps, steps_dataframe
from mdtopo.pipeline import Tally, block_of, refuse_winding, with_coordinate_error
from mdtopo.pipeline.cluster import LOST_WORKER
from mdtopo.planning import Setting, reference_samples
from mdtopo.readers import ReaderRequest, Source
from mdtopo.readers.mdanalysis import MDAnalysisReader
from mdtopo.records import Frame, MonitorConfig, StepTable

SHOWN_COLUMNS = ("verdict", "clearance", "pair_ratio")
"""Columns that the one line about the results names, of the many there are."""


@dataclass(frozen=True, slots=True, eq=False)
class FrameGroup:
    """What one worker measured.

    Attributes
    ----------
    frames : tuple of int
        Its frames, in order.
    tables : tuple of StepTable
        The steps between them, numbered from 0.
    setting : Setting
        The setting after the last frame.
    """

    frames: tuple[int, ...]
    tables: tuple[StepTable, ...]
    setting: Setting


class ClusterBackend(BackendBase):  # type: ignore[misc] # MDAnalysis has no py.typed
    """Gives the groups of frames as tasks to a cluster of dask.distributed.

    Parameters
    ----------
    n_workers : int
        Into how many groups the frames are split, unless `n_parts` says it.
    client : distributed.Client
        Of a cluster whose workers find the trajectory under the same name.
    """

    def __init__(self, n_workers: int, client: Any) -> None:
        super().__init__(n_workers=n_workers)
        self._client = client

    def apply(self, func: Callable[[Any], Any], computations: list[Any]) -> list[Any]:
        """Return what the function makes of each group.

        Raises
        ------
        ClusterError
            If the workers that had a group died.
        """
        from distributed import KilledWorker

        # in bytes: tasks of one worker would be given one object, and its trajectory stands at one frame
        packed = self._client.scatter(pickle.dumps(func), hash=False)
        tasks = [self._client.submit(_on_a_copy, packed, group, pure=False) for group in computations]
        try:
            done: list[Any] = self._client.gather(tasks)
        except KilledWorker as error:
            raise ClusterError(f"A group of frames was not measured: {LOST_WORKER}.") from error
        return done


def _on_a_copy(packed: bytes, group: Any) -> Any:
    return pickle.loads(packed)(group)


def _active_client() -> Any:
    """Return the client that Dask's own functions would use now; None where there is none."""
    distributed = sys.modules.get("distributed")  # who has made a client has imported it
    if distributed is None:
        return None
    try:
        return distributed.default_client()
    except ValueError:
        return None


class IsotopyResults(Results):  # type: ignore[misc] # MDAnalysis has no py.typed
    """What `IsotopyAnalysis` leaves behind, with the habits of a notebook."""

    def _columns(self) -> dict[str, Any]:
        return {column.name: self[column.name] for column in StepTable.columns()}

    def plot(self, ax: Any = None) -> Any:
        """Return matplotlib axes with clearance, ratio, limit and alerts; see `mdtopo.notebook.plot_steps`."""
        return plot_steps(self._columns(), 0, self["config"], self["alerts"], ax)

    def to_dataframe(self) -> Any:
        """Return the step columns as a pandas DataFrame; see `mdtopo.notebook.steps_dataframe`."""
        return steps_dataframe(self._columns(), 0)

    def __repr__(self) -> str:
        """Return the run in one line: its columns are no help at a prompt."""
        summary = self.get("summary")
        if summary is None:  # a worker's, before the end
            return f"<IsotopyResults: {', '.join(map(str, self))}>"
        held = f"{summary.n_steps} steps, {len(self['alerts'])} alerts"
        return f"<IsotopyResults: {summary.verdict.value}, {held}; a column for each of {', '.join(SHOWN_COLUMNS)}, …>"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        html: str = self["summary"]._repr_html_()
        return html


class IsotopyAnalysis(AnalysisBase):  # type: ignore[misc] # MDAnalysis has no py.typed
    """Measures every step between consecutive analysed frames of an AtomGroup or Universe.

    Parameters
    ----------
    atomgroup : MDAnalysis AtomGroup or Universe
        The backbone atoms; of a Universe, or a group of all atoms, the default trace is taken.
    select : str, optional
        Which atoms of it are the backbone.
    config : MonitorConfig, optional
        Every other knob.
    verbose : bool
        Whether MDAnalysis shows its progress bar.

    Attributes
    ----------
    results : MDAnalysis Results
        After `run`: every column of `mdtopo.records.StepTable` by its name (``results.clearance``, ``results.verdict``,
        …), ``steps`` (the whole `StepTable`), ``alerts`` (a list of `Alert`), ``summary`` (a `RunSummary`), ``config``
        (the `MonitorConfig`); it has ``plot()`` and ``to_dataframe()``.

    Raises
    ------
    InputError
        If the atoms do not form strands.

    Notes
    -----
    With ``backend="dask"``, frames are measured on the cluster of the active `distributed.Client`; where there is none,
    by processes of this machine, as MDAnalysis does it.

    Guarantee
    ---------
    Proven: see `mdtopo.measure.measure_plan`. On every backend the numbers are those of `mdtopo.monitor`, bit for bit.

    Examples
    --------
    >>> run = IsotopyAnalysis(universe, select="name CA").run(backend="dask", n_workers=2)  # doctest: +SKIP
    >>> run.results.clearance.min()  # doctest: +SKIP
    """

    _analysis_algorithm_is_parallelizable: ClassVar[bool] = True

    @classmethod
    def get_supported_backends(cls) -> tuple[str, ...]:
        """Return the names of the backends that `run` takes."""
        return ("serial", "multiprocessing", "dask")

    def __init__(
        self, atomgroup: Any, *, select: str | None = None, config: MonitorConfig | None = None, verbose: bool = False
    ) -> None:
        super().__init__(atomgroup.universe.trajectory, verbose=verbose)
        self._reader = MDAnalysisReader.open(Source(object=atomgroup), ReaderRequest(select=select))
        self._config = with_coordinate_error(config or MonitorConfig(), self._reader)
        first = list(self._reader.frames(0, self._config.reference_frames))
        refuse_winding(first[0], self._reader.strands)
        refuse_long_strands(self._reader.strands, self._config.curve)
        self._periodic = first[0].cell is not None
        reference = reference_lengths(reference_samples(first, self._reader.strands))
        # a list of frames has no even windows, so no profile is kept
        self._start = Setting.start(self._reader.strands, replace(self._config, profile_steps=0), reference)

    def run(self, *args: Any, **kwargs: Any) -> "IsotopyAnalysis":
        """Run the analysis; parameters as of MDAnalysis' `AnalysisBase.run`.

        On a cluster, `n_workers` is by default the number of tasks that it does at once.
        """
        client = _active_client() if kwargs.get("backend") == "dask" else None
        if client is not None and kwargs.get("n_workers") is None:
            kwargs["n_workers"] = max(sum(client.nthreads().values()), 1)
        done: IsotopyAnalysis = super().run(*args, **kwargs)
        return done

    def _configure_backend(self, backend: Any, n_workers: int, unsupported_backend: bool = False) -> Any:
        """Return MDAnalysis' own backend, or that of the cluster which is active."""
        usual = super()._configure_backend(backend, n_workers, unsupported_backend)
        client = _active_client() if backend == "dask" else None
        return usual if client is None else ClusterBackend(n_workers, client)

    def _compute(self, *args: Any, **kwargs: Any) -> Any:
        """Measure one group of frames on a copy of its own.

        A pool of processes sends several groups to one worker as the *same* object, and would get the last group's
        results back for all of them.
        """
        worker = copy(self)
        worker.results = Results()
        return super(IsotopyAnalysis, worker)._compute(*args, **kwargs)

    def _prepare(self) -> None:
        """Start a group of frames: called once by each worker."""
        self.results.groups = []
        self._setting = self._start
        self._pending: list[Frame] = []
        self._tables: list[StepTable] = []
        self._seen: list[int] = []

    def _single_frame(self) -> None:
        frame = self._reader.current_frame()
        self._pending.append(frame)
        self._seen.append(frame.index)
        is_last = self._frame_index == self.n_frames - 1
        if is_last or len(self._pending) > self._config.block_steps:
            self._measure_pending()
        if is_last:
            self.results.groups = [FrameGroup(tuple(self._seen), tuple(self._tables), self._setting)]

    def _measure_pending(self) -> None:
        """Measure the steps between the frames that wait, and keep the last one for the next block."""
        first_step = sum(len(table) for table in self._tables)
        block = block_of(self._pending, first_step, periodic=self._periodic)
        table, self._setting = measure_block(block, self._setting)
        self._tables.append(table)
        self._pending = self._pending[-1:]

    def _get_aggregator(self) -> ResultsGroup:
        return ResultsGroup(lookup={"groups": ResultsGroup.flatten_sequence})

    def _conclude(self) -> None:
        groups: Sequence[FrameGroup] = self.results.pop("groups", [])
        tables = list(self._in_order(groups))
        steps = StepTable.joined(tables)
        stream, tally = AlertStream(self._reader.strands, self._config), Tally(self._config, self._reader.strands)
        alerts = [*stream.opening(), *stream.after(steps), *stream.finish()]
        tally.add(steps)
        tally.alerts.update(alert.severity for alert in alerts)
        self.results: Any = IsotopyResults(**self.results)
        self.results.steps, self.results.alerts, self.results.config = steps, alerts, self._config
        self.results.summary = tally.summary(None, "")
        for column in StepTable.columns():
            self.results[column.name] = getattr(steps, column.name)

    def _in_order(self, groups: Sequence[FrameGroup]) -> Iterator[StepTable]:
        """Yield the tables of all groups with the steps at the seams, numbered through."""
        setting, first_step, last_frame = self._start, 0, -1
        for position, group in enumerate(groups):
            if position > 0:
                table, setting = self._measured_again((last_frame, group.frames[0]), first_step, setting)
                first_step += len(table)
                yield table
            if setting.bonds.is_intact:  # what the worker assumed when it started
                tables, setting = group.tables, group.setting
            else:
                table, setting = self._measured_again(group.frames, first_step, setting)
                tables = (table,)
            for table in tables:
                yield table.moved_to(first_step)
                first_step += len(table)
            last_frame = group.frames[-1]

    def _measured_again(self, frames: Sequence[int], first_step: int, setting: Setting) -> tuple[StepTable, Setting]:
        """Read frames again and measure the steps between them."""
        tables, count = [], self._config.block_steps
        for start in range(0, max(len(frames) - 1, 1), count):
            chosen = frames[start : start + count + 1]
            read = [next(self._reader.frames(index, index + 1)) for index in chosen]
            block = block_of(read, first_step + start, periodic=self._periodic)
            table, setting = measure_block(block, setting)
            tables.append(table)
        return StepTable.joined(tables), setting
