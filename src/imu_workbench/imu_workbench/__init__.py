# SPDX-License-Identifier: Apache-2.0
"""Commands, report and web page that compare IMU thermal models with measurements."""

import os

# Before numpy is loaded: on small matrices OpenBLAS threads wait longer for a core than they work.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
