"""Everything that MDAnalysis opens: topology and trajectory files, a Universe or an AtomGroup.

MDAnalysis itself is imported inside `opening` and `reader` when a source is opened: it takes seconds.
"""

from mdtopo.readers.mdanalysis.reader import MDAnalysisReader

__all__ = ["MDAnalysisReader"]
