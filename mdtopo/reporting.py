"""From results files to reports on the disk: the one place where a report and the trajectory meet."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from mdtopo.curvetypes import step_types, types_in_words
from mdtopo.errors import InputError
from mdtopo.records import Frame
from mdtopo.reopening import frames_at, input_files, open_again
from mdtopo.report import (
    CURVE_COLUMNS,
    NEEDED,
    Event,
    OverviewRow,
    RunData,
    Scene,
    event_place,
    event_scene,
    multiqc_files,
    ranked_events,
    render_overview,
    render_page,
    step_path,
)
from mdtopo.store import read_so_far
from mdtopo.store.atomic import check_target, write_text

MOST_SCENES = 16
"""Events that are shown with a picture and a 3D view where nobody asks for more: the worst."""


def write_report(
    results: Path, out: Path, inputs: Sequence[Path] = (), *, views: int | None = None, overwrite: bool = False
) -> RunData:
    """Write the report of a run, one page that needs no other file, and return the run.

    Parameters
    ----------
    results : Path
        The results file; of a run that has not ended, its finished parts are shown.
    out : Path
        The page.
    inputs : sequence of Path
        Topology and trajectory, where they have moved; by default the stored paths. Where they are missing or have
        changed, the page says so and has everything but the pictures of the events.
    views : int, optional
        How many events are shown in 3D, the worst; by default up to 16, as many as a page below 8 MB has room for.
    overwrite : bool
        Whether an existing page may be replaced.

    Raises
    ------
    InputError
        If the results cannot be read.
    OutputError
        If the page cannot be written, or exists already.
    """
    check_target(out, overwrite=overwrite)
    run = RunData.of(results, read_so_far(results, columns=NEEDED, optional=CURVE_COLUMNS, profile=True))
    scenes, why = event_scenes(run, inputs, MOST_SCENES if views is None else views)
    write_text(out, render_page(run, scenes, no_views=why, n_views=views))
    return run


def write_overview(
    results: Sequence[Path],
    out: Path,
    *,
    views: int | None = None,
    multiqc: bool = False,
    overwrite: bool = False,
) -> list[OverviewRow]:
    """Write a page for each of many runs beside one page that names them all, worst first, and return its rows.

    A results file that cannot be read has a row that says why, and no page.

    Parameters
    ----------
    results : sequence of Path
        The results files.
    out : Path
        The overview; the page of a run is named after both.
    views : int, optional
        As for `write_report`.
    multiqc : bool
        Whether to write what MultiQC takes of each run too.
    overwrite : bool
        Whether existing pages may be replaced.

    Raises
    ------
    OutputError
        If a page cannot be written, or exists already.
    """
    check_target(out, overwrite=overwrite)
    rows, taken = [], {out.name}
    for path in results:
        page, count = f"{out.stem}-{path.stem}.html", 1
        while page in taken:
            count += 1
            page = f"{out.stem}-{path.stem}-{count}.html"
        taken.add(page)
        try:
            run = write_report(path, out.with_name(page), views=views, overwrite=overwrite)
        except InputError as error:
            rows.append(OverviewRow(str(path), None, "", str(error)))
            continue
        rows.append(OverviewRow(str(path), run, page))
        if multiqc:
            write_multiqc(run, out.with_name(page), overwrite=overwrite)
    write_text(out, render_overview(rows))
    return rows


def write_multiqc(run: RunData, page: Path, *, overwrite: bool = False) -> list[Path]:
    """Write what MultiQC takes of a run beside its page, and return the files.

    Raises
    ------
    OutputError
        If a file cannot be written, or exists already.
    """
    written = []
    for name, text in multiqc_files(run, page.stem).items():
        path = page.with_name(f"{page.stem}_{name}_mqc.json")
        check_target(path, overwrite=overwrite)
        write_text(path, text)
        written.append(path)
    return written


def event_scenes(run: RunData, inputs: Sequence[Path] = (), most: int = MOST_SCENES) -> tuple[dict[str, Scene], str]:
    """Return the surroundings of the worst events by the id of their alert, and why there are none, in one sentence."""
    shown = [event for event in ranked_events(run) if event.has_view][:most]
    if not shown:
        return {}, ""
    try:
        paths, _ = input_files(run.path, run.results, inputs)
        frames = _frames(run, paths, shown)
    except InputError as error:
        return {}, f"There are no views of the events, because the trajectory could not be opened again: {error}"
    periodic = frames[0].cell is not None
    scenes = {}
    for event in shown:
        pair = (frames[event.frames[0]], frames[event.frames[1]]) if event.frames is not None else None
        path = pair and step_path(pair, run.results.strands, run.results.broken, run.config, periodic)
        if path:
            t, on_curve = event_place(run, event)
            kind = run.config.curve if run.config.curve != "none" else "interpolating"
            scene = event_scene(*path, run.results.strands, event.edges, t, kind, on_curve)
            if run.config.curve != "none" and event.frames is not None:
                types = step_types(*path, run.results.strands, event.alert.strands, kind)
                scene = replace(scene, own_type=types_in_words(types, event.frames))
            scenes[event.alert.id] = scene
    return scenes, ""


def _frames(run: RunData, paths: Sequence[Path], shown: Sequence[Event]) -> dict[int, Frame]:
    """Return the frames of the events by their index; the trajectory's first says whether the run is periodic."""
    wanted = sorted({0, *(frame for event in shown for frame in event.frames or ())})
    with open_again(run.path, run.results, paths) as reader:
        stream = frames_at(reader, wanted)
        return {frame.index: frame for frame in (next(stream) for _ in wanted)}
