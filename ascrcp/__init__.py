"""Automatic Shotcrete Robot Control Platform."""

import os

__version__ = "0.1.0"

# The matrices here are small: BLAS threads only spin, a tenth of the solving's time, beside the control
# thread. NumPy reads this when it is first imported; the compute process inherits it.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
