"""Draws the self-test's picture anew, after a change to the kernels that is meant to change pictures.

    python tools/selftest.py [DEVICE]              writes clfur/selftest.npz

Then `clfur devices --check` must pass on every device.
"""

import sys
from pathlib import Path

import numpy as np

from clfur.judge import selftest

if __name__ == "__main__":
    target = Path(selftest.__file__).with_suffix(".npz")
    np.savez_compressed(target, **selftest.picture(sys.argv[1] if len(sys.argv) > 1 else None))
    print(f"{target}: {target.stat().st_size:,} bytes")
