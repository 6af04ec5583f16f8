"""The whole job: reader → blocks of frames → step tables → alerts → results. The only place where they meet."""

from mdtopo.pipeline.clusterrun import monitor_on_cluster
from mdtopo.pipeline.framing import block_of, refuse_winding
from mdtopo.pipeline.merge import merge
from mdtopo.pipeline.run import PartLength, monitor
from mdtopo.pipeline.stopping import StopRequest, stopping_on_signals
from mdtopo.pipeline.tables import open_input, step_tables, steps, with_coordinate_error
from mdtopo.pipeline.tally import Progress, Tally

__all__ = [
    "PartLength",
    "Progress",
    "StopRequest",
    "Tally",
    "block_of",
    "merge",
    "monitor",
    "monitor_on_cluster",
    "open_input",
    "refuse_winding",
    "step_tables",
    "steps",
    "stopping_on_signals",
    "with_coordinate_error",
]
