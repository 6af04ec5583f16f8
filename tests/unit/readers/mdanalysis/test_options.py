from dataclasses import fields

import pytest

from mdtopo.errors import OptionError
from mdtopo.readers.mdanalysis.options import OPTION_HELP, STRAND_OPTIONS, Options


def test_text_of_the_command_line_becomes_values():
    options = Options.from_mapping({"dt": "0.5", "convert_units": "no", "format": " LAMMPS ", "cut": "7"})
    assert options == Options(dt=0.5, convert_units=False, format="LAMMPS", cut=7.0)


def test_values_of_python_are_taken_as_they_are():
    assert Options.from_mapping({"dt": 2, "use_bonds": False}) == Options(dt=2.0, use_bonds=False)


def test_every_option_has_help_and_a_field():
    assert set(OPTION_HELP) == {field.name for field in fields(Options)}
    assert set(OPTION_HELP) > STRAND_OPTIONS


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("dt", value) for value in ("0", "-1", "nan", "inf", "fast", None, True)),
        *(("time_offset", value) for value in ("later", "inf", False)),
        *(("cut", value) for value in ("0", -5.0, "1 nm")),
        *(("convert_units", value) for value in ("maybe", "", 2, None, 1.0)),
        *(("format", value) for value in ("", "  ", 3, None)),
        ("atom_style", ["id", "type"]),
        ("lengthunit", 10),
    ],
)
def test_nonsense_is_refused_by_name(name, value):
    with pytest.raises(OptionError, match=f"option '{name}' is"):
        Options.from_mapping({name: value, **({"format": "LAMMPS"} if name == "lengthunit" else {})})


def test_an_unknown_name_is_refused_with_those_that_exist():
    with pytest.raises(OptionError, match=r"Unknown option 'topologyformat'.* topology_format"):
        Options.from_mapping({"topologyformat": "PDB"})


@pytest.mark.parametrize("name", ["lengthunit", "timeunit"])
def test_units_without_the_lammps_format_would_do_nothing_and_are_refused(name):
    with pytest.raises(OptionError, match="pass --reader-option format=LAMMPS too"):
        Options.from_mapping({name: "nm"})
    assert Options.from_mapping({name: "nm", "format": "lammps"}).chosen(name) == {name: "nm"}


def test_a_universe_takes_options_of_strands_only():
    assert Options.from_mapping({"cut": 6.0, "close_ends": "yes"}, is_file=False).close_ends
    with pytest.raises(OptionError, match=r"'dt' says how to open a file.*MDAnalysis\.Universe"):
        Options.from_mapping({"dt": 1.0}, is_file=False)
