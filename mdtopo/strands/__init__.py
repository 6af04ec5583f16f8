"""Which vertices form which strand: rules over a plain record of what a file says of the selected atoms.

A reader fills an `AtomTable`; `strands_from_atoms` answers with `Traces`: the strands, the order in which the
atoms must be taken, and what was left out or cut, in words. Lengths are in Å.
"""

from mdtopo.strands.atoms import AtomTable
from mdtopo.strands.traces import Traces, strands_from_atoms

__all__ = ["AtomTable", "Traces", "strands_from_atoms"]
