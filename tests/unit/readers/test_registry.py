import logging
import subprocess
import sys
import textwrap
import tomllib
from pathlib import Path

import numpy as np
import pytest

from mdtopo.errors import (
    InputError,
    MissingDependencyError,
    MissingFileError,
    OptionError,
    UnknownFormatError,
)
from mdtopo.readers import Reader, ReaderRequest, Source, installed_readers, open_reader, registry
from mdtopo.readers.arrays import ArraysReader
from mdtopo.records import Frame, Strands
from mdtopo.testing import Expectation, ReaderContract

ROOT = Path(__file__).parents[3]
STRANDS = Strands.from_lengths([3])
POSITIONS = np.arange(45.0).reshape(5, 3, 3)

PLUGIN = """
    import numpy as np
    from mdtopo.readers import Reader, Source
    from mdtopo.records import Frame, Strands

    class {name}(Reader):
        summary = "Text tables of three vertices"
        option_help = {{"shift": "added to every coordinate, Å"}}

        def __init__(self, rows):
            self.rows = rows

        @classmethod
        def can_open(cls, source):
            return bool(source.paths) and source.paths[0].suffix == ".{suffix}"

        @classmethod
        def open(cls, source, request):
            return cls(np.loadtxt(source.paths[0]) + float(request.options.get("shift", 0.0)))

        n_frames = property(lambda self: len(self.rows))
        strands = property(lambda self: Strands.from_lengths([3]))
        coordinate_error = property(lambda self: 0.0)

        def frames(self, start=None, stop=None, step=None):
            for index in range(len(self.rows))[slice(start, stop, step)]:
                yield Frame(index, float(index), self.rows[index].reshape(3, 3).copy())

        def close(self):
            pass
"""


class Site:
    """A folder on sys.path into which distributions are installed."""

    def __init__(self, folder):
        self.folder = folder

    def install(self, distribution, reader, target, code):
        module = target.partition(":")[0]
        (self.folder / f"{module}.py").write_text(textwrap.dedent(code))
        info = self.folder / f"{distribution.replace('-', '_')}-1.5.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 1.5\n")
        (info / "entry_points.txt").write_text(f"[{registry.GROUP}]\n{reader} = {target}\n")

    def table_reader(self, reader="table", module="mdtopo_table_plugin", suffix="table"):
        code = PLUGIN.format(name="TableReader", suffix=suffix)
        self.install("table-reader", reader, f"{module}:TableReader", code)

    def broken_reader(self, code="import nowhere_to_be_found", module="mdtopo_broken_plugin"):
        self.install("broken-reader", "broken", f"{module}:BrokenReader", code)


@pytest.fixture
def site(tmp_path, monkeypatch):
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(folder)
    monkeypatch.setattr(registry, "_announced", set())
    before = set(sys.modules)
    yield Site(folder)
    for name in set(sys.modules) - before:
        if name.startswith("mdtopo_"):
            del sys.modules[name]


@pytest.fixture
def table(tmp_path):
    np.savetxt(tmp_path / "run.table", POSITIONS.reshape(5, 9), fmt="%.1f")
    return Source(paths=(tmp_path / "run.table",))


def plugins_in(broken):
    return [one for one in broken if one.distribution != "mdtopo"]


def open_plain(source, **how):
    return open_reader(source, ReaderRequest(), **how)


class TestInstalledPlugin(ReaderContract):
    @pytest.fixture(autouse=True)
    def _found(self, site, monkeypatch):
        site.table_reader()
        monkeypatch.setattr(type(self), "reader_class", installed_readers().readers["table"], raising=False)

    @pytest.fixture
    def source(self, table):
        return table

    @pytest.fixture
    def request_(self):
        return ReaderRequest(options={"shift": "0.5"})

    @pytest.fixture
    def expected(self):
        return Expectation(
            frames=tuple(Frame(k, float(k), xyz + 0.5) for k, xyz in enumerate(POSITIONS)), strands=STRANDS
        )


def test_a_plugin_that_is_installed_or_removed_meanwhile_is_noticed(site):
    assert "table" not in installed_readers().readers
    site.table_reader()
    assert "table" in installed_readers().readers
    info = site.folder / "table_reader-1.5.dist-info"
    for file in info.iterdir():
        file.unlink()
    info.rmdir()
    assert "table" not in installed_readers().readers


class OverwritingReader(Reader):
    """Yields one buffer again and again: the fault that the contract must find."""

    summary = "Wrong on purpose"

    @classmethod
    def can_open(cls, source):
        return source.object == "overwritten"

    @classmethod
    def open(cls, source, request):
        return cls()

    n_frames = 5
    strands = STRANDS
    coordinate_error = 0.0

    def frames(self, start=None, stop=None, step=None):
        buffer = np.empty((3, 3))
        for index in range(5)[slice(start, stop, step)]:
            buffer[:] = POSITIONS[index]
            yield Frame(index, float(index), buffer)

    def close(self):
        pass


def test_the_contract_finds_a_reader_that_overwrites():
    contract = ReaderContract()
    contract.reader_class = OverwritingReader
    source, request = Source(object="overwritten"), ReaderRequest()
    truth = Expectation(tuple(Frame(k, float(k), POSITIONS[k]) for k in range(5)), STRANDS)
    contract.test_it_counts_its_frames(source, request, truth)
    with pytest.raises(AssertionError, match="frame 0: other positions"):
        contract.test_no_frame_is_overwritten(source, request, truth)


def test_the_built_in_readers_are_those_of_the_package_metadata():
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"][registry.GROUP]
    built_in = (*registry.ASKED_FIRST, *registry.ASKED_LAST)
    assert {point.name: point.value for point in built_in} == declared


def test_arrays_is_asked_first_and_mdanalysis_last(site):
    site.table_reader(reader="zzz")
    names = list(installed_readers().readers)
    assert names[0] == "arrays"
    assert names.index("zzz") < names.index("mdanalysis")


def test_a_plugin_opens_its_files(site, table):
    site.table_reader()
    with open_plain(table) as reader:
        assert type(reader).__name__ == "TableReader"
    with open_plain(table, reader="table") as reader:
        assert type(reader).__name__ == "TableReader"


def test_a_reader_that_was_named_is_not_asked(tmp_path):
    np.savez(tmp_path / "run.dat", positions=POSITIONS, offsets=[0, 3], closed=[False])
    renamed = (tmp_path / "run.dat.npz").rename(tmp_path / "run.dat")
    with open_plain(Source(paths=(renamed,)), reader="arrays") as reader:
        assert reader.n_frames == 5


def test_only_the_readers_that_are_asked_are_imported(site, table):
    site.table_reader(reader="aaa")
    site.broken_reader(code="raise AssertionError('was imported')")
    assert isinstance(
        open_reader(Source(object=POSITIONS), ReaderRequest(strands=STRANDS)),
        ArraysReader,
    )
    assert "mdtopo_table_plugin" not in sys.modules
    open_plain(table).close()
    assert "mdtopo_table_plugin" in sys.modules


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        ("import nowhere_to_be_found", "ModuleNotFoundError: No module named 'nowhere_to_be_found'"),
        ("1 / 0", "ZeroDivisionError: division by zero"),
        ("def BrokenReader(", "SyntaxError: "),
        ("x = 1", "AttributeError: "),
        ("BrokenReader = int", "<class 'int'> is not a subclass of mdtopo.readers.Reader"),
        ("BrokenReader = 5", "5 is not a subclass of mdtopo.readers.Reader"),
        (
            "from mdtopo.readers import Reader\nclass BrokenReader(Reader): frames = strands = n_frames = 0",
            "it does not define can_open, close, coordinate_error, open",
        ),
    ],
)
def test_a_broken_plugin_warns_once_and_stops_nobody(site, caplog, code, reason):
    site.broken_reader(code=code)
    site.table_reader()
    for _ in range(2):
        listing = installed_readers()
    assert "table" in listing.readers
    (broken,) = plugins_in(listing.broken)
    assert (broken.name, broken.distribution, broken.version) == ("broken", "broken-reader", "1.5")
    assert reason in broken.reason
    (record,) = (entry for entry in caplog.records if "broken" in entry.getMessage())
    assert record.levelno == logging.WARNING
    assert "broken-reader 1.5" in record.getMessage()


def test_a_broken_plugin_that_is_named_says_why(site):
    site.broken_reader()
    with pytest.raises(MissingDependencyError, match=r"broken-reader 1.5\): .*nowhere_to_be_found"):
        open_plain(Source(object=POSITIONS), reader="broken")


def test_a_plugin_that_fails_when_asked_is_passed_over(site, table, caplog):
    code = PLUGIN.format(name="BrokenReader", suffix="x") + "    BrokenReader.can_open = lambda source: 1 / 0\n"
    site.broken_reader(code=textwrap.dedent(code).replace("    BrokenReader.can", "BrokenReader.can"))
    site.table_reader()
    with open_plain(table) as reader:
        assert type(reader).__name__ == "TableReader"
    assert "can_open failed with ZeroDivisionError" in caplog.text


def test_a_plugin_cannot_take_the_name_of_another(site, caplog):
    site.table_reader(reader="arrays")
    listing = installed_readers()
    assert listing.readers["arrays"] is ArraysReader
    assert [broken.distribution for broken in plugins_in(listing.broken)] == ["table-reader"]
    assert "the name is taken by mdtopo.readers.arrays:ArraysReader" in caplog.text


def test_a_missing_file(tmp_path, monkeypatch):
    with pytest.raises(MissingFileError, match=r"nowhere\.npz does not exist\.$"):
        open_plain(Source(paths=(tmp_path / "nowhere.npz",)))
    monkeypatch.chdir(tmp_path)
    with pytest.raises(MissingFileError, match=f"seen from {tmp_path}"):
        open_plain(Source(paths=(Path("nowhere.npz"),)))


def test_every_path_is_looked_at(table, tmp_path):
    with pytest.raises(MissingFileError, match="second"):
        open_plain(Source(paths=(*table.paths, tmp_path / "second")))


def test_a_directory(tmp_path):
    (tmp_path / "run.npz").mkdir()
    with pytest.raises(InputError, match=r"run\.npz is a directory; a file was expected"):
        open_plain(Source(paths=(tmp_path / "run.npz",)))


def test_a_file_that_may_not_be_read(table, monkeypatch):
    # a test may run as root, who may read everything
    monkeypatch.setattr(registry.os, "access", lambda path, mode: False)
    with pytest.raises(InputError, match="may not be read"):
        open_plain(table)


def test_no_input_at_all():
    with pytest.raises(InputError, match="There is no input"):
        open_plain(Source())


def test_an_unknown_format_lists_what_is_installed(site, tmp_path):
    site.broken_reader()
    (tmp_path / "run.nonsense-format").touch()
    with pytest.raises(UnknownFormatError) as caught:
        open_plain(Source(paths=(tmp_path / "run.nonsense-format",)))
    message = str(caught.value)
    assert "No installed reader takes " in message
    assert f"arrays ({ArraysReader.summary})" in message
    assert "Not usable: broken (from broken-reader 1.5): " in message
    with pytest.raises(UnknownFormatError, match="takes a builtins set"):
        open_plain(Source(object={1}))


def test_an_unknown_reader_lists_the_names(table):
    with pytest.raises(OptionError, match=r"No installed reader is called 'array'; there are: arrays, .*mdanalysis"):
        open_plain(table, reader="array")


def test_an_unknown_option_lists_the_options(site, table):
    site.table_reader()
    with pytest.raises(OptionError, match=r"'shft': TableReader has the options shift \(added to every"):
        open_reader(table, ReaderRequest(options={"shft": "1"}))
    with pytest.raises(OptionError, match="OverwritingReader has no options"):
        registry.open_with(OverwritingReader, table, ReaderRequest(options={"shft": "1"}))


def test_an_import_that_fails_while_opening(site, table):
    site.table_reader()
    (module := site.folder / "mdtopo_table_plugin.py").write_text(
        module.read_text().replace("        return cls(", "        import nowhere_to_be_found\n        return cls(")
    )
    with pytest.raises(MissingDependencyError, match=r"cannot open .*run.table.*nowhere_to_be_found"):
        open_plain(table)


def test_an_open_reader_is_returned_as_it_is():
    opened = OverwritingReader()
    assert open_plain(Source(object=opened)) is opened
    with pytest.raises(OptionError, match="is open already and cannot take 'select'"):
        open_reader(Source(object=opened), ReaderRequest(select="name CA"))
    with pytest.raises(OptionError, match="cannot take 'reader'"):
        open_plain(Source(object=opened), reader="arrays")
    with pytest.raises(OptionError, match="cannot take 'stride'"):
        open_reader(Source(object=opened), ReaderRequest(options={"stride": "2"}))


def test_nothing_heavy_is_imported():
    code = (
        "import sys, numpy, mdtopo.readers as readers\n"
        "from mdtopo.records import Strands\n"
        "readers.installed_readers()\n"
        "source = readers.Source(object=numpy.zeros((1, 2, 3)))\n"
        "readers.open_reader(source, readers.ReaderRequest(strands=Strands.from_lengths([2])))\n"
        "print([name for name in ('MDAnalysis', 'h5py', 'pytest') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
