"""Speed and memory of every stage beside a peer that does the same work.

    python -m benchmarks                      all stages, at the size `medium`
    python -m benchmarks --size full bags csv only these, at full size
    python -m benchmarks.growth               time and memory against size
    python -m benchmarks.compare OLD NEW      which stages one commit made slower

From the root of the repository, with the extra `bench` installed. The studies of accuracy beside
this are commands of their own.
"""

import os

# One thread each: a peer is not to be slowed by threads that wait for a busy core.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
