"""MUC-OSL and its relatives: two estimators, two planners, and their compositions (see `policies`)."""
