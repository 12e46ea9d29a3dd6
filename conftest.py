"""Settings of the test run that must stand before numpy is imported."""

import os

# many small matrices: threads of linear algebra cost more than they give, and disturb one another
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

# a fault of ours ends a run instead of being left out; tests of that pass a guard of their own
os.environ["BAYESDEG_STRICT"] = "1"
