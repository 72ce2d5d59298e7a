"""Calibration: what is the point spread function at this distance? The answer is a table."""
