"""Kernels: arrays in, arrays out. No I/O, no logging, no classes.

They trust their input: positions are finite C-contiguous float64 in Å, indices are in range. Validation happens once,
at the border (`mdtopo.records`, `mdtopo.measure`). A point inside a kernel is a tuple ``(x, y, z)``, which the compiler
keeps in registers. All kernels release the GIL and none uses fast-math, so that the same input gives the same bits on
every thread.
"""

from mdtopo.kernelfiles import keep_signatures_apart

keep_signatures_apart()
