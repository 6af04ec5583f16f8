"""The referee: judges one step again, slowly, and shares no code with the ladder.

It looks at every pair of edges in every image, throws out those whose swept boxes are apart, and decides the rest in
integers, without rounding. What it takes from mdtopo is the common rotation, because that is part of what the path of a
step *is*; it checks that this is a rotation.

| module | answers |
|---|---|
| `polynomials` | where integer polynomials have roots in [0, 1], and which sign others have there |
| `meeting` | when two moving edges meet, and whether one passes through the other |
| `cells` | short lattice vectors, nearest images |
| `paths` | which linear motion a step is |
| `search` | which pairs can be near each other, in which image |
| `distances` | how far edges are apart |
| `steps` | all of it for one step |
| `curves` | the smooth curve of a step, built again by SciPy |
"""

from mdtopo.referee.curves import CurveCase
from mdtopo.referee.meeting import Meeting, judge_pair
from mdtopo.referee.steps import FoundContact, FoundCrossing, StepCase, open_step

__all__ = ["CurveCase", "FoundContact", "FoundCrossing", "Meeting", "StepCase", "judge_pair", "open_step"]
