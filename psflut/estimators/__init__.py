"""Estimators of distance, one method a file; see `psflut.estimation` for the contract."""
