"""Settings of the test run that must stand before numpy is imported."""

import os

# many small matrices: threads of linear algebra cost more than they give, and disturb one another
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")
